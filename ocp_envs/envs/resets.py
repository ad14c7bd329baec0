"""The options of a reset, validated."""

from __future__ import annotations

import numpy as np

from ocp_envs.envs.outcome import Info
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.suggestions import did_you_mean

NAMES = ("parameters", "extrapolate")
MASK = "reset_mask"


def given_parameters(
    problem: OptimalControlProblem, options: Info, count: int, names: tuple[str, ...] = NAMES
) -> Array | None:
    """The parameters (count, np) among the ``options`` of a reset of ``count`` episodes of ``problem``, if given.

    Raises:
        ValueError: an option that is not among ``names``, or parameters of another shape, not finite, outside their
            box without ``extrapolate``, or with an initial state that is outside the operating box or violates a path
            constraint.
    """
    for name in options:
        if name not in names:
            hint = did_you_mean(name, names)
            raise ValueError(f"{problem.id}: unknown option {name!r} of reset(); {hint}known are {list(names)}")
    if options.get("parameters") is None:
        return None
    p = problem.check_parameters(options["parameters"], extrapolate=bool(options.get("extrapolate", False)))
    box = problem.system.state
    outside = ~box.contains(problem.start(p)[0], 1e-6)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        raise ValueError(
            f"{problem.id}: parameters {p[row]} (row {row}) give an initial state outside the operating box "
            f"{box.lower} … {box.upper}, where no episode can begin"
        )
    for row, reason in infeasible_rows(problem, p, goal=False).items():
        raise ValueError(f"{problem.id}: parameters {p[row]} (row {row}) begin where no episode can: {reason}")
    if len(p) not in (1, count):
        expected = "one episode" if count == 1 else f"1 or {count} rows"
        raise ValueError(f"{problem.id}: expected parameters of {expected}, got {len(p)}")
    return np.broadcast_to(p, (count, p.shape[1]))


def due_rows(problem: OptimalControlProblem, options: Info, count: int) -> Ints:
    """Indices of the rows, of ``count`` of a vector environment of ``problem``, that a reset with ``options`` begins.

    Raises:
        ValueError: a mask of another shape or type, or without a True.
    """
    mask = np.asarray(options.get(MASK, np.ones(count, dtype=np.bool_)))
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        raise ValueError(
            f"{problem.id}: options['{MASK}'] must be a boolean array ({count},) with at least one True, "
            f"got {mask.dtype} of shape {mask.shape}"
        )
    return np.flatnonzero(mask)
