"""Policies that track a plan and regulate the state at the goal afterwards.

Within a plan, at control step k, with the reference x̄, ū of :mod:`moe_policy.control.resampling` and the gains K of
:mod:`moe_policy.control.lqr`,

    u = the projection of ū_k − K_k (x ⊖ x̄_k) onto the bounds, in the norm weighted by H_k,

where ⊖ takes the shorter way round for periodic coordinates. After the plan x̄ is the goal, ū the control that holds it
and K the gain of the discrete regulator there; where the goal is not an equilibrium that an LQR can stabilise, K = 0
and ū is applied unchanged. Terminal regulation is thus one more row of the arrays, at which the control step stays.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.export import write
from moe_policy.control.following import Following
from moe_policy.control.lqr import Regulator
from moe_policy.control.observations import split
from moe_policy.control.policy import ModelPolicy
from moe_policy.control.step import ControlStep, Tracking
from moe_policy.control.watch import Watched
from moe_policy.control.weights import TrackingWeights
from moe_policy.planners.owner import plans_of
from moe_policy.protocols import Planner, Schedule, State
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


class TrackingPolicy(ModelPolicy):
    """Turns a planner into a policy: plan at the beginning of an episode, track the plan, hold the goal.

    A plan is clipped to the boxes before it is tracked; a duration outside ``problem.duration`` is counted. A plan that
    is not finite, or has no finite gains, is rejected and counted: its row holds the goal from the initial state on.
    Parameters outside their box raise no error, and no control is NaN unless the observation is. Without a recurrent
    state, and where an episode starts, the parameters are read off the observation. Its own recurrent state is a
    :class:`Tracking`; that of ``predict`` also holds what was seen of the environment.

    Args:
        problem: the problem of the environment.
        planner: maps parameters (B, np) to plans.
        dt: control period of the environment, seconds.
        weights: tracking weights; :meth:`TrackingWeights.default` where not given.
    """

    recurrent = Tracking

    @checked
    def __init__(
        self,
        problem: ProblemOrId,
        planner: Planner,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
    ) -> None:
        problem = problem_of(problem)
        self.problem, self.planner = problem, planner
        self.regulator = Regulator(problem, dt, weights)
        self.dt = self.regulator.dt
        self._following = Following(self.regulator)
        self._step = ControlStep(problem, self.regulator.substeps)

    @checked
    def start(self, parameters: ArrayLike) -> Tracking:
        """The recurrent state before the first control step, with plans for ``parameters`` (B, np) or (np,) in float64.

        Raises:
            ValueError: parameters of another shape, or plans of another problem's.
        """
        p = np.array(parameters, dtype=np.float64, ndmin=2)
        width = len(self.problem.parameters)
        if p.shape[1:] != (width,):
            raise ValueError(f"{self.problem.id}: expected parameters (B, {width}), got {np.shape(parameters)}")
        return self.follow(plans_of(self.planner, p), self.problem.start(p)[1])

    def follow(self, plan: Trajectory, contexts: Array) -> Tracking:
        """The recurrent state before the first control step of the B plans in ``plan``, in ``contexts`` (B, nc)."""
        return self._following(plan, contexts)

    def schedule(self, state: State) -> Schedule:
        """When the plans of a recurrent ``state`` of this policy or of its ``predict`` end and are evaluated."""
        own: Tracking = state.inner if isinstance(state, Watched) else state
        return own.schedule

    def act(self, observations: NDArray[np.floating], state: Tracking | None, begins: Bools) -> tuple[Array, Tracking]:
        seen = np.ascontiguousarray(observations, dtype=np.float64)
        if state is None:
            state = self.start(self._parameters(seen))
        elif np.count_nonzero(begins) and len(state.clock) == len(seen):
            state = state.restarted(begins, self.start(self._parameters(seen[begins])))
        return self._step(seen, state), state.later()

    def _parameters(self, observations: Array) -> Array:
        """The parameters (B, np) that are read off ``observations`` (B, nx + nc)."""
        return self.problem.parameters_of(*split(self.problem, observations))

    @checked
    def to_c(self, folder: str | os.PathLike[str], name: str = "policy") -> Path:
        """Write this policy as C: one file and its header, without allocation, for a controller that has no Python.

        The functions ``<name>_start`` (plan and regulators) and ``<name>_act`` (a control step) do what :meth:`start`
        and :meth:`act` do for one row; the header ``<name>.h`` describes them. Their controls agree to rounding for the
        same plan; plans agree to that of single precision, in which only Python evaluates networks.

        Args:
            folder: where the files are written; it is made where it is missing.
            name: what the names of the files and of their functions begin with, an identifier of C.

        Returns:
            the path of the C file ``<name>.c``.

        Raises:
            TypeError: the planner is no :class:`~moe_policy.planners.network.NetworkPlanner`.
            ValueError: a name that is no identifier, or a goal that is not one state for all instances.
        """
        return write(self, Path(folder), name)

    def __repr__(self) -> str:
        return f"TrackingPolicy({self.problem.id!r}, {self.planner!r}, dt={self.dt})"
