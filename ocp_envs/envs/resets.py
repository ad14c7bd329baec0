"""The options of a reset, validated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ocp_envs.envs.outcome import Info
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.suggestions import did_you_mean

_NAMES = ("parameters", "extrapolate")
_MASK = "reset_mask"


@dataclass(frozen=True, eq=False)
class Reset:
    """What a reset begins.

    Args:
        rows: indices of the episodes that begin.
        parameters: p of each of them, (len(rows), np), or ``None`` where they are to be drawn.
    """

    rows: Ints
    parameters: Array | None

    @staticmethod
    def of_one(problem: OptimalControlProblem, options: Info | None) -> Reset:
        """Of a single environment.

        Args:
            problem: of the environment.
            options: ``parameters`` (np,) and ``extrapolate``, as given to ``reset``.

        Raises:
            ValueError: an unknown option, or parameters of another shape, not finite, outside their box without
                ``extrapolate``, or with an initial state outside the operating box.
        """
        p = _parameters(problem, options or {}, _NAMES)
        if p is not None and len(p) != 1:
            raise ValueError(f"{problem.id}: expected the parameters of one episode, got {len(p)} rows")
        return Reset(np.array([0]), p)

    @staticmethod
    def of_many(problem: OptimalControlProblem, options: Info | None, count: int) -> Reset:
        """Of a vector environment.

        Args:
            problem: of the environment.
            options: ``parameters`` (np,) or (count, np), ``extrapolate`` and ``reset_mask`` (count,) bool.
            count: number of episodes of the environment.

        Raises:
            ValueError: as for :meth:`of_one`, or a mask of another shape or type or without a True.
        """
        given = options or {}
        p = _parameters(problem, given, (*_NAMES, _MASK))
        if p is not None and len(p) not in (1, count):
            raise ValueError(f"{problem.id}: expected parameters of 1 or {count} rows, got {len(p)}")
        mask = np.asarray(given.get(_MASK, np.ones(count, dtype=np.bool_)))
        if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(
                f"{problem.id}: options['{_MASK}'] must be a boolean array ({count},) with at least one True, "
                f"got {mask.dtype} of shape {mask.shape}"
            )
        rows = np.flatnonzero(mask)
        return Reset(rows, None if p is None else np.broadcast_to(p, (count, p.shape[1]))[rows])


def _parameters(problem: OptimalControlProblem, options: Info, names: tuple[str, ...]) -> Array | None:
    """The parameters (B, np) among ``options``, whose names must be among ``names``."""
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
    return p
