"""The compiled part of tracking: the gains along plans, and the control step."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.kept import kept
from ocp_envs.support.programs import entry, library

#: The C of the control step, which other programs call as well, and that of all of tracking.
STEP, *_OTHERS = (Path(__file__).with_name(name) for name in ("step.c", "riccati.c", "follow.c"))
TRACKING = (STEP, *_OTHERS)


class Program(NamedTuple):
    """The functions of the same names in ``follow.c`` and ``step.c``."""

    follow: Callable[..., None]
    act: Callable[..., None]


def compiled(problem: OptimalControlProblem, substeps: int) -> Program | None:
    """The program for control steps of ``problem`` in ``substeps`` Runge-Kutta steps; ``None`` where it cannot be."""
    return _compiled(problem, substeps, os.environ.get("CC"), os.environ.get("PATH"))


@kept
def _compiled(problem: OptimalControlProblem, substeps: int, compiler: str | None, path: str | None) -> Program | None:
    """The program; the environment variables say which ``compiler`` there is on the ``path``."""
    functions = [problem.functions.rate().function, problem.functions.linearisation(substeps).jacobian.function]
    sizes = {"NX": problem.system.nx, "NU": problem.system.nu, "NC": len(problem.context)}
    made = library(TRACKING, functions, sizes)
    return None if made is None else Program(entry(made, "follow", "qqq" + 10 * "p"), entry(made, "act", "qqppppp"))
