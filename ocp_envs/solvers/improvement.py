"""Plans improved by a few iterations of the solver, or by as many as it takes.

The solver begins at the plan and keeps its solution family, which is that of the winding nearest to the plan's end.
There is no second attempt and no other solver: where the solver breaks down, the plan stays as it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.solver import lent_solvers
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.trajectory import Trajectory

#: Knots over which a margin grows from the clearance at an end.
RAMP = 4


class Improved(NamedTuple):
    """B plans ``trajectory``, and which of them the solver ``converged`` to and the check of solutions passed, (B,)."""

    trajectory: Trajectory
    converged: Bools


def improve(
    problem: OptimalControlProblem,
    parameters: Array,
    plans: Trajectory,
    iterations: int | None = None,
    margin: Array | float = 0.0,
) -> Improved:
    """The plans at which the solver ends that begins at ``plans``, B of them; they begin at the initial states.

    A plan that is not finite, or on which the solver breaks down, stays as it was but for its first state.

    Args:
        problem: the problem.
        parameters: of the instances, (B, np), their angles in the turn around the centre of the box.
        plans: B trajectories.
        iterations: at most so many of the solver; ``None`` until it converges.
        margin: what the clearances at the knots k ≥ 1 have to be at least, in their unit; one for all instances or one
            for each, (B,); less at the ends, see :func:`knot_margins`.
    """
    finite = plans.finite
    with lent_solvers(problem).one() as solver:
        solutions, ends = solver.attempts(
            parameters,
            plans,
            np.full(len(parameters), NEAREST_WINDING),
            retry_with_fallback=False,
            rescue=False,
            iterations=iterations,
            margins=knot_margins(problem, parameters, margin),
        )
    states = plans.states.copy()
    states[finite, 0] = problem.start(parameters)[0][finite]
    begun = Trajectory(states, plans.controls, plans.duration)
    solved, ended = solutions.solved, ends.finite
    trajectory = begun.replaced(ended, ends[ended]).replaced(solved, solutions.trajectory[solved])
    return Improved(trajectory, solved)


def knot_margins(problem: OptimalControlProblem, parameters: Array, margin: Array | float) -> Array:
    """What the clearances at the knots k ≥ 1 have to be at least for a ``margin`` (B,) or one for all, (B, N − 1).

    It is less at the ends of the instances of ``problem`` with ``parameters`` (B, np), if the initial state or the goal
    is closer to a constraint: from their clearance it grows to the margin over :data:`RAMP` knots.
    """
    size, last = len(parameters), problem.knots - 1
    wanted = np.broadcast_to(margin, (size,))[:, None]
    knots = np.arange(1, last + 1)
    if not problem.n_clearances:
        return np.broadcast_to(wanted, (size, last))
    initial, contexts = problem.start(parameters)
    # Where the goal is no single state, plans end where there is room for the margin.
    goal = problem.terminal.states(contexts)
    at_start, at_goal = (
        np.maximum(problem.functions.clearances()(states, contexts)[0].min(axis=1), 0.0)[:, None]
        for states in (initial, goal)
    )
    if not problem.terminal.pinned:
        at_goal = np.full_like(at_goal, np.inf)
    ramp = wanted / RAMP
    possible = np.minimum(at_start + ramp * (knots - 1), at_goal + ramp * (last - knots))
    return np.asarray(np.minimum(wanted, possible))
