"""What the model says about a plan: its episode up to the plan's end, before any terminal regulation.

The episode is that of :class:`~moe_policy.control.tracking.TrackingPolicy` in the environment: the same control steps,
the same observations in single precision, the same criteria.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.control.tracking import Tracking, TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from moe_policy.rollouts.ledger import Violations
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.clock import count_steps
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: What a forecast may be off by, since sums of another order round differently: a fraction of the goal's radius, and of
#: the unit of the clearances.
SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class Predicted(Batch):
    """The predicted episodes of B plans; all arrays are (B,).

    Args:
        cost: ∫L dt up to the first entry into the goal ball; of the whole episode where there is none.
        final_error: ‖x − goal‖ at the plan's end.
        clearance: smallest clearance initially, at the ends of control steps and at the plan's knots, in the unit of
            the path constraints; +inf without any.
        left_box: the state left the operating box.
        rejected: the plan was not finite, or has no finite gains.
        success: at the plan's end the state is in the goal ball, having kept all constraints.
    """

    cost: Array
    final_error: Array
    clearance: Array
    left_box: Bools
    rejected: Bools
    success: Bools


class Forecast:
    """Predicts the episodes of plans.

    Args:
        problem: what is planned for.
        dt: control period of the environment, seconds.
        weights: tracking weights; those of the problem by default.
        plant: the model that is simulated; the problem itself by default.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
        plant: OptimalControlProblem | None = None,
    ) -> None:
        self.problem = problem
        self._policy = TrackingPolicy(problem, _no_planner, dt, weights)
        self._simulator = Simulator(problem if plant is None else plant, dt)
        self.dt = self._policy.dt

    def __call__(self, parameters: Array, plans: Trajectory) -> Predicted:
        """The episodes of B ``plans`` for instances with ``parameters`` (B, np)."""
        states, contexts = self.problem.start(parameters)
        tracking = self._policy.follow(plans, contexts)
        return self._run(states, contexts, tracking)

    def _run(self, x: Array, contexts: Array, tracking: Tracking) -> Predicted:
        problem, schedule = self.problem, tracking.schedule
        size, radius = len(x), problem.goal.radius
        ends = count_steps(schedule.plan_end, self.dt)
        path = Violations(problem, self.dt, x, contexts, schedule.knot_step)
        error = problem.goal_error(x)
        cost, entered, left, none = np.zeros(size), error < radius, np.zeros(size, bool), np.zeros(size, bool)
        for step in range(1, int(ends.max(initial=0)) + 1):
            running = (step <= ends) & ~left
            observed = np.concatenate([x, contexts], axis=1).astype(np.float32)
            controls, tracking = self._policy.act(observed, tracking, none)
            result = self._simulator.advance(x, controls, contexts)
            path.add(step, running, x, result.states)
            cost += np.where(running & ~entered, result.cost, 0.0)
            left |= running & result.left_box
            error = np.where(running, problem.goal_error(result.states), error)
            entered |= running & (error < radius) & ~left
            x = np.where(running[:, None], result.states, x)
        clear = path.clearance >= (SLACK if problem.n_clearances else -np.inf)
        success = (error < radius * (1 - SLACK)) & clear & ~left & ~schedule.rejected
        return Predicted(cost, error, path.clearance, left, schedule.rejected, success)


def _no_planner(parameters: Array) -> Trajectory:
    raise AssertionError("plans are given")
