"""Checks of the fields of a problem and of how they fit together, before its functions are tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from gymnasium.envs.registration import ENV_ID_RE

from ocp_envs.distribution import Distribution
from ocp_envs.goal import Goal, Modes, OfContext
from ocp_envs.picture import Picture
from ocp_envs.support import fields
from ocp_envs.support.arrays import Array
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, System, inside

if TYPE_CHECKING:
    from ocp_envs.problem import Bound, OptimalControlProblem

_KINDS: dict[str, type] = {
    "title": str,
    "system": System,
    "parameters": Box,
    "goal": Goal,
    "modes": Modes,
    "distribution": Distribution,
}
_FUNCTIONS = ("cost_rate", "terminal_cost", "clearance", "inequalities", "equalities")
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
    for name in _FUNCTIONS:
        if getattr(problem, name) is not None:
            fields.function(owner, name, getattr(problem, name))
    if problem.cost_rate is None and problem.terminal_cost is None:
        raise ValueError(f"{owner}: expected a cost_rate, a terminal_cost or both, got neither")


def checked_fields(problem: OptimalControlProblem) -> dict[str, object]:
    """The numbers among the fields of ``problem`` in their proper types, by name, after a check of all types.

    Raises:
        TypeError: a field of another type.
        ValueError: a field out of its range.
    """
    _check_types(problem)
    owner, duration = problem.id, _duration(problem)
    limit, longest = fields.positive(owner, "time_limit", problem.time_limit), duration[1]
    if not callable(longest) and limit < longest:
        raise ValueError(
            f"{owner}: time_limit must be at least the longest duration, {longest:g} s, or episodes end before their "
            f"plans do; got {limit:g} s"
        )
    return {
        "duration": duration,
        "knots": fields.whole(owner, "knots", problem.knots, 2),
        "substeps": fields.whole(owner, "substeps", problem.substeps, 1),
        "hold": fields.not_negative(owner, "hold", problem.hold),
        "time_limit": limit,
        "longest_substep": fields.positive(owner, "longest_substep", problem.longest_substep),
        "rest": _rest(problem),
        "planned": _planned(problem),
        "clearance_points": fields.whole(owner, "clearance_points", problem.clearance_points, 1),
    }


def _duration(problem: OptimalControlProblem) -> tuple[float | Bound, float | Bound]:
    """The bounds of the duration of ``problem``, each a number or a function."""
    bounds = problem.duration
    if isinstance(bounds, Sequence) and len(bounds) == 2 and any(map(callable, bounds)):
        low, high = (
            bound if callable(bound) else fields.positive(problem.id, "a bound of duration", bound) for bound in bounds
        )
        return low, high
    return fields.interval(problem.id, "duration", bounds)


def _rest(problem: OptimalControlProblem) -> Array | OfContext | None:
    rest = problem.rest
    if rest is None and not isinstance(problem.goal.state, np.ndarray):
        missing = [name for name in problem.system.state.names if name not in problem.parameters.names]
        if not missing:
            return problem.system.state.centre  # all of them are replaced by p
        raise ValueError(
            f"{problem.id}: the goal does not fix where {missing} begin, which are no parameters; declare "
            "their initial values with rest"
        )
    return rest if rest is None or callable(rest) else fields.vector(problem.id, "rest", rest)


def _planned(problem: OptimalControlProblem) -> Mapping[str, tuple[float, float]] | None:
    """The bounds of plans of ``problem``, a mapping that cannot be changed."""
    planned = problem.planned
    if planned is None:
        return None
    fields.instance(problem.id, "planned", planned, Mapping)  # type: ignore[type-abstract]
    for name, sides in planned.items():
        if name not in (*problem.system.state.names, *problem.system.control.names):
            raise ValueError(f"{problem.id}: planned has bounds of {name!r}, which is neither a state nor a control")
        if not isinstance(sides, Sequence) or len(sides) != 2:
            raise TypeError(f"{problem.id}: planned[{name!r}] must be a pair (lower, upper), got {sides!r}")
    return MappingProxyType({name: (float(low), float(high)) for name, (low, high) in planned.items()})


def check_parts(problem: OptimalControlProblem) -> None:
    """Refuse parts of ``problem`` that do not fit together.

    Raises:
        ValueError: shapes that differ from those of the system, no parameters, or a goal or initial states outside the
            operating box.
    """
    owner, system = problem.id, problem.system
    if isinstance(problem.rest, np.ndarray):
        if problem.rest.shape != (system.nx,):
            raise ValueError(f"{owner}: rest must have shape ({system.nx},), got {problem.rest.shape}")
        inside(owner, "rest", problem.rest, system.state)
    check_goal(problem)
    try:
        problem.planned_states, problem.planned_controls  # noqa: B018
    except ValueError as error:
        raise ValueError(f"{owner}: planned: {error}") from None
    if not len(problem.parameters):
        raise ValueError(f"{owner}: parameters must have at least one coordinate")
    for end, corner in (("lower", problem.parameters.lower), ("upper", problem.parameters.upper)):
        states, _ = problem.start(corner[None])
        inside(owner, f"the initial state at the {end} ends of parameters", states[0], system.state)
    problem.distribution.check(problem)
    if problem.symmetry is not None:
        problem.symmetry.check(owner, system.nx, system.nu, len(problem.context))


def check_goal(problem: OptimalControlProblem) -> None:
    """Refuse a goal that does not fit ``problem``.

    Raises:
        ValueError: other shapes than those of its system, a winding of a coordinate without a period, a range of a
            periodic coordinate with one side, or a goal state, a goal control or a target outside the operating box.
    """
    owner, system, goal = problem.id, problem.system, problem.goal
    nx, nu = system.nx, system.nu
    windings, tolerance = goal.windings_of(nx), goal.tolerance_of(nx)
    state = goal.state.shape if isinstance(goal.state, np.ndarray) else (nx,)
    control = goal.control.shape if isinstance(goal.control, np.ndarray) else (nu,)
    if state != (nx,) or control != (nu,) or windings.shape[1:] != (nx,) or tolerance.shape != (nx,):
        raise ValueError(
            f"{owner}: expected a goal with state ({nx},), control ({nu},), windings (W, {nx}); "
            f"got {state}, {control}, {windings.shape}"
            + (f" and a tolerance of shape {tolerance.shape}" if tolerance.shape != (nx,) else "")
        )
    if np.any(windings[:, system.state.periods == 0]):
        raise ValueError(f"{owner}: goal.windings has whole turns of a coordinate without a period")
    terminal, centre = problem.terminal, problem.context.centre[None]
    state = terminal.states(centre)
    inside(owner, "goal.state", state[0], system.state)
    inside(owner, "goal.control", terminal.controls(centre)[0], system.control)
    for row in windings:
        inside(owner, f"the goal with the winding {row.tolist()}", state[0] + row * system.state.periods, system.state)
