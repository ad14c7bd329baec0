"""Compiled solver functions.

CasADi writes the functions of a nonlinear program (objective, constraints and their derivatives) as C; compiled
functions are three to five times as fast as interpreted ones.
"""

from __future__ import annotations

import casadi as ca

from ocp_envs.support.compiler import compiled

#: -O1 evaluates as fast as -O2 here (within 3 %) and compiles in two thirds of the time. ``-w``: the C is generated.
FLAGS = ("-O1", "-w")


def build_solver(plugin: str, nlp: ca.Function, options: dict[str, object]) -> ca.Function:
    """``casadi.nlpsol`` with compiled functions; with interpreted ones and one warning where that is impossible.

    The ``plugin`` is "fatrop" or "ipopt", ``nlp`` the function (x, p) → (f, g); ``options`` are those of ``nlpsol``.

    Raises:
        RuntimeError: CasADi refuses the program or the options.
    """

    def interpreted() -> ca.Function:
        return ca.nlpsol("solver", plugin, nlp, options)

    # The serialised program stands for the C generated from it: CasADi's version is part of the key, and writing the C
    # takes longer than loading the library.
    content = (nlp.serialize(), plugin)
    solver = compiled(
        plugin,
        content,
        lambda: _functions_of(interpreted()),
        FLAGS,
        lambda library: ca.nlpsol("solver", plugin, str(library), options),
    )
    return interpreted() if solver is None else solver


def _functions_of(solver: ca.Function) -> str:
    # What ``generate_dependencies`` does; that one can write into the working directory only.
    generator = ca.CodeGenerator("functions.c")
    generator.add(solver.oracle())
    for name in solver.get_function():
        generator.add(solver.get_function(name))
    return str(generator.dump())
