"""Which problem a planner plans for, and its plans, checked: a planner may be any function."""

from __future__ import annotations

from moe_policy.protocols import Planner
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


def check_owner(problem: OptimalControlProblem, owner: object, what: str) -> None:
    """Refuse ``what`` with a ValueError if its ``owner`` is a problem of another id than ``problem``."""
    if isinstance(owner, OptimalControlProblem) and owner.id != problem.id:
        raise ValueError(f"{what} belongs to {owner.id}, not to {problem.id}")


def planned_problem(planner: Planner, problem: ProblemOrId | None = None) -> OptimalControlProblem:
    """What ``planner`` plans for: ``problem``, or the problem of that name; by default its attribute of that name.

    Raises:
        TypeError: a planner that cannot be called.
        ValueError: neither is given, or the two have different ids.
    """
    if not callable(planner):
        raise TypeError(f"expected a planner, which maps parameters to plans, got {type(planner).__name__}")
    own = getattr(planner, "problem", None)
    if problem is None:
        if not isinstance(own, OptimalControlProblem):
            name = getattr(planner, "name", type(planner).__name__)
            raise ValueError(f"the planner {name} does not say what it plans for; give problem=…")
        return own
    given = problem_of(problem)
    check_owner(given, own, "the planner")
    return given


def plans_of(planner: Planner, parameters: Array) -> Trajectory:
    """The plans of ``planner`` for ``parameters`` (B, np).

    Raises:
        TypeError: the planner returns something else than a Trajectory.
        ValueError: it returns another number of plans.
    """
    plans: object = planner(parameters)
    if not isinstance(plans, Trajectory):
        raise TypeError(
            f"expected a Trajectory of {len(parameters)} plans from {planner!r}, got {type(plans).__name__}"
        )
    if len(plans) != len(parameters):
        raise ValueError(f"expected {len(parameters)} plans from {planner!r}, one for each row, got {len(plans)}")
    return plans
