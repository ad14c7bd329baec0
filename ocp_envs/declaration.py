"""Checks of the fields of a problem and of how they fit together, before its functions are tried."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gymnasium.envs.registration import ENV_ID_RE

from ocp_envs.distribution import Distribution
from ocp_envs.goal import Goal, Modes
from ocp_envs.picture import Picture
from ocp_envs.support import fields
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, System, inside

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

_KINDS: dict[str, type] = {
    "title": str,
    "system": System,
    "parameters": Box,
    "goal": Goal,
    "modes": Modes,
    "distribution": Distribution,
}
_OPTIONAL: dict[str, type] = {"picture": Picture, "symmetry": Symmetry}


def _check_types(problem: OptimalControlProblem) -> None:
    owner = fields.words("problem", "id", problem.id)
    if ENV_ID_RE.fullmatch(owner) is None:
        raise ValueError(f"problem: id must be a name for Gymnasium, such as 'CartPole-v0', got {owner!r}")
    for name, kind in _KINDS.items():
        fields.instance(owner, name, getattr(problem, name), kind)
    for name, kind in _OPTIONAL.items():
        if getattr(problem, name) is not None:
            fields.instance(owner, name, getattr(problem, name), kind)
    fields.function(owner, "cost_rate", problem.cost_rate)
    if problem.clearance is not None:
        fields.function(owner, "clearance", problem.clearance)


def checked_fields(problem: OptimalControlProblem) -> dict[str, object]:
    """The numbers among the fields of ``problem`` in their proper types, by name, after a check of all types.

    Raises:
        TypeError: a field of another type.
        ValueError: a field out of its range.
    """
    _check_types(problem)
    owner, longest = problem.id, fields.interval(problem.id, "duration", problem.duration)[1]
    limit = fields.positive(owner, "time_limit", problem.time_limit)
    if limit < longest:
        raise ValueError(
            f"{owner}: time_limit must be at least the longest duration, {longest:g} s, or episodes end before their "
            f"plans do; got {limit:g} s"
        )
    return {
        "duration": fields.interval(owner, "duration", problem.duration),
        "knots": fields.whole(owner, "knots", problem.knots, 2),
        "substeps": fields.whole(owner, "substeps", problem.substeps, 1),
        "hold": fields.not_negative(owner, "hold", problem.hold),
        "time_limit": limit,
        "longest_substep": fields.positive(owner, "longest_substep", problem.longest_substep),
        "rest": None if problem.rest is None else fields.vector(owner, "rest", problem.rest),
    }


def check_parts(problem: OptimalControlProblem) -> None:
    """Refuse parts of ``problem`` that do not fit together.

    Raises:
        ValueError: shapes that differ from those of the system, no parameters, or a goal or initial states outside the
            operating box.
    """
    owner, system = problem.id, problem.system
    problem.goal.check(owner, system)
    if problem.rest is not None:
        if problem.rest.shape != (system.nx,):
            raise ValueError(f"{owner}: rest must have shape ({system.nx},), got {problem.rest.shape}")
        inside(owner, "rest", problem.rest, system.state)
    if not len(problem.parameters):
        raise ValueError(f"{owner}: parameters must have at least one coordinate")
    for end, corner in (("lower", problem.parameters.lower), ("upper", problem.parameters.upper)):
        states, _ = problem.start(corner[None])
        inside(owner, f"the initial state at the {end} ends of parameters", states[0], system.state)
    problem.distribution.check(problem)
    if problem.symmetry is not None:
        problem.symmetry.check(owner, system.nx, system.nu, len(problem.context))
