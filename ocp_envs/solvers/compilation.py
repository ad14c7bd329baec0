"""Compiled solver functions.

CasADi writes the functions of a nonlinear program (objective, constraints and their derivatives) as C; compiled
functions are three to five times as fast as interpreted ones. Loops over the stages of the program become kernels,
which evaluate several stages at once (:mod:`ocp_envs.support.kernels`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import casadi as ca

from ocp_envs.solvers.derivatives import WrittenOut, written_out
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support import kernels
from ocp_envs.support.compiler import NATIVE, compiled, written_by

#: -O1 evaluates as fast as -O2 here (within 3 %) and compiles in two thirds of the time. ``-w``: the C is generated.
FLAGS = ("-O1", *NATIVE, "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-w")
#: Functions of a stage with more instructions are evaluated one stage after another: as kernels they would take minutes
#: to compile.
MOST_INSTRUCTIONS = 60_000


def build_solver(plugin: str, program: Transcription, options: dict[str, object]) -> ca.Function:
    """``casadi.nlpsol`` with compiled functions; with interpreted ones and one warning where that is impossible.

    The ``plugin`` is "fatrop" or "ipopt" for the ``program``; ``options`` are those of ``nlpsol``.

    Raises:
        RuntimeError: CasADi refuses the program or the options.
    """
    nlp = program.nlp

    def interpreted() -> ca.Function:
        return ca.nlpsol("solver", plugin, nlp, options)

    def write() -> str:
        written = written_out(program) if plugin == "fatrop" else WrittenOut({}, ())
        return _vectorised(_functions_of(interpreted(), written.functions), written.stages)

    # The serialised program stands for the C generated from it: CasADi's version is part of the key, and writing the C
    # takes longer than loading the library.
    content = (nlp.serialize(), plugin, written_by(__name__, kernels.__name__, written_out.__module__))
    solver = compiled(plugin, content, write, FLAGS, lambda path: ca.nlpsol("solver", plugin, str(path), options))
    return interpreted() if solver is None else solver


def _functions_of(solver: ca.Function, instead: Mapping[str, ca.Function]) -> str:
    """The C of the functions that ``solver`` calls, with those of ``instead`` for its own of the same names."""
    # What ``generate_dependencies`` does; that one can write into the working directory only.
    generator = ca.CodeGenerator("functions.c")
    generator.add(solver.oracle())
    for name in solver.get_function():
        generator.add(instead.get(name) or solver.get_function(name))
    return str(generator.dump())


def _vectorised(text: str, stages: Sequence[ca.Function]) -> str:
    """CasADi's C ``text`` with kernels for its loops over the functions ``stages``, where it has such loops."""
    found = []
    for function in stages:
        if kernels.vectorisable(function) and function.n_instructions() <= MOST_INSTRUCTIONS:
            loop = rf"(/\* map(\d+)_{function.name()}:.*\n.*\{{\n)(?:.*\n)*?\}}\n"
            text, count = re.subn(loop, rf"\1  {kernels.symbol(function)}(\2, arg, res);\n  return 0;\n}}\n", text)
            found += [function] if count else []
    if not found:
        return text
    declarations = [f"{kernels.declaration(function)};" for function in found]
    return "\n".join([*declarations, text, kernels.source(found)])
