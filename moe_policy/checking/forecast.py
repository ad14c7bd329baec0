"""What the model says about a plan: its episode up to the plan's end, and terminal regulation where it succeeds.

The episode is that of :class:`~moe_policy.control.tracking.TrackingPolicy` in the environment: the same control steps,
the same observations in single precision, the same criteria.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.checking.episodes import compiled, run, run_compiled
from moe_policy.control.step import Tracking
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory

#: What a forecast may be off by, since sums of another order round differently: a fraction of the goal's radius, and of
#: the unit of the clearances.
SLACK = 1e-5


@dataclass(frozen=True, eq=False)
class Predicted(Batch):
    """The predicted episodes of B plans; all arrays are (B,).

    Args:
        cost: ∫L dt up to the first entry into the goal ball; of the whole episode where there is none.
        final_error: ‖x − goal‖ at the plan's end.
        clearance: smallest clearance initially, at the ends of control steps and at the plan's knots, in the unit of
            the path constraints; +inf without any. Until the plan's end, and if the plan succeeds until the evaluation.
        left_box: the state left the operating box.
        rejected: the plan was not finite, or has no finite gains.
        success: at the plan's end the state is in the goal ball, before any terminal regulation; it is still there at
            the evaluation; and all constraints are kept until then.
        total: ∫L dt up to the plan's end, with the terminal cost.
    """

    cost: Array
    final_error: Array
    clearance: Array
    left_box: Bools
    rejected: Bools
    success: Bools
    total: Array


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
        return self.continued(states, contexts, self._policy.follow(plans, contexts))

    def continued(self, states: Array, contexts: Array, tracking: Tracking) -> Predicted:
        """The episodes from ``states`` (B, nx) in ``contexts`` (B, nc) with the recurrent state ``tracking``."""
        problem, simulator, schedule = self.problem, self._simulator, tracking.schedule
        program = compiled(simulator.problem, simulator.step_function)
        if program is None:
            ended = run(self._policy, simulator, states, contexts, tracking)
        else:
            ended = run_compiled(program, problem, self.dt, states, contexts, tracking)
        clear = ended.clearance >= (SLACK if problem.n_clearances else -np.inf)
        reached = (ended.error < problem.goal.radius * (1 - SLACK)) & ended.stayed
        success = reached & clear & ~ended.left_box & ~schedule.rejected
        told = (ended.cost, ended.error, ended.clearance, ended.left_box)
        return Predicted(*told, schedule.rejected, success, ended.total)


def _no_planner(parameters: Array) -> Trajectory:
    raise AssertionError("plans are given")
