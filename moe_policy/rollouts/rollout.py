"""One loop for every policy: episodes of an environment from given parameters, and what became of them.

    reached    the state entered the goal ball ‖x − goal‖ < radius at the start or at the end of some tick
    success    the state was in the goal ball at the judging time
    cost       ∫L dt up to the first entry, or of the whole episode where there is none

A policy that plans knows its judging time from the start (see :class:`moe_policy.protocols.PlanningPolicy`). Any other
one, and any with ``evaluation="goal"``, is judged ``problem.hold`` seconds after its first entry, at the latest at the
horizon. An episode ends when it is judged or when it leaves the operating box, which the environment charges and which
is never a success.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike

from moe_policy.protocols import PlanningPolicy, Policy, Schedule
from moe_policy.rollouts.episodes import Episodes as Episodes
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.batch import BatchFunction
from ocp_envs.support.clock import count_steps

#: What ends an episode: the plan's schedule, or the first entry into the goal ball.
Evaluation = Literal["schedule", "goal"]


class _Log:
    """Keeps the books of one batch of episodes, tick by tick."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        dt: float,
        ticks: int,
        states: Array,
        contexts: Array,
        schedule: Schedule | None,
    ) -> None:
        size = len(states)
        self.problem, self.dt, self.ticks, self.schedule = problem, dt, ticks, schedule
        self.contexts = contexts
        self.open = np.ones(size, bool)
        self.error: Array = problem.goal_error(states)
        self.success = np.zeros(size, bool)
        self.left_box = np.zeros(size, bool)
        self.cost = np.zeros(size)
        self.final_error = np.full(size, np.nan)
        self.plan_end_error = np.full(size, np.nan)
        self.entry = np.where(self.error < problem.goal.radius, 0, -1)
        self.judging = np.full(size, ticks)
        self.plan_end = np.full(size, -1)
        self.knot_violation = np.full(size, np.nan)
        if schedule is not None:
            self.judging = np.minimum(count_steps(schedule.judging, dt), ticks)
            self.plan_end = np.minimum(count_steps(schedule.plan_end, dt), ticks)
            self.knot_violation = np.where(np.isfinite(schedule.knot_step), 0.0, np.nan)
        else:
            self._judge_after_hold(self.entry == 0, 0)
        self.violation = np.zeros(size)
        self._clearances: BatchFunction | None = problem.batch_clearances() if problem.n_clearances else None
        if self._clearances is not None:
            self.violation = self._violation(states, contexts)
            self.knot_violation = np.where(np.isnan(self.knot_violation), np.nan, self.violation)
        self._look(0, self.entry == 0)

    def _judge_after_hold(self, rows: Bools, tick: int) -> None:
        self.judging[rows] = min(tick + int(count_steps(self.problem.hold, self.dt)), self.ticks)

    def _violation(self, states: Array, contexts: Array) -> Array:
        assert self._clearances is not None
        return np.maximum(0.0, -self._clearances(states, contexts)[0].min(axis=1))

    def _look(self, tick: int, inside: Bools) -> None:
        """Note what is due at ``tick``: the plan's end and the judgement."""
        at_end = self.open & (self.plan_end == tick)
        self.plan_end_error[at_end] = self.error[at_end]
        judged = self.open & (self.judging == tick)
        self.final_error[judged] = self.error[judged]
        self.success[judged] = inside[judged]
        self.open &= ~judged

    def add(self, tick: int, before: Array, after: Array, cost: Array, left_box: Bools) -> None:
        """The tick that ends at ``tick``: states (B, nx) before and after it, its cost and failures (B,)."""
        running = self.open.copy()
        self.error = self.problem.goal_error(after)
        inside = (self.error < self.problem.goal.radius) & ~left_box
        if self._clearances is not None:
            self._watch_path(tick, running, before, after)
        self.cost[running & (self.entry < 0)] += cost[running & (self.entry < 0)]
        entered = running & inside & (self.entry < 0)
        self.entry[entered] = tick
        if self.schedule is None:
            self._judge_after_hold(entered, tick)

        left = running & left_box
        self.left_box |= left
        self.judging[left] = tick
        if self.schedule is not None:
            self.plan_end[left & (self.plan_end > tick)] = tick
        self._look(tick, inside)

    def _watch_path(self, tick: int, running: Bools, before: Array, after: Array) -> None:
        self.violation[running] = np.maximum(self.violation, self._violation(after, self.contexts))[running]
        if self.schedule is None:
            return
        # Knots fall between ticks; over one tick a chord is as good as the path. At most one knot a tick is looked at,
        # so plans with several knots a tick are looked at once a tick.
        knot = np.floor(tick * self.dt / self.schedule.knot_step + 1e-9)
        share = knot * self.schedule.knot_step / self.dt - (tick - 1)
        rows = running & (share > 0) & (knot < self.problem.knots)
        if rows.any():
            at_knot = before[rows] + share[rows, None] * (after[rows] - before[rows])
            violation = self._violation(at_knot, self.contexts[rows])
            self.knot_violation[rows] = np.maximum(self.knot_violation[rows], violation)

    def episodes(self, parameters: Array) -> Episodes:
        size = len(parameters)
        none = np.zeros(size, bool)
        return Episodes(
            parameters=parameters,
            reached=self.entry >= 0,
            success=self.success,
            cost=self.cost,
            entry_time=np.where(self.entry >= 0, self.entry * self.dt, np.nan),
            judging_time=self.judging * self.dt,
            final_error=self.final_error,
            plan_end_error=self.plan_end_error,
            left_box=self.left_box,
            violation=self.violation,
            knot_violation=self.knot_violation,
            clipped=none if self.schedule is None else self.schedule.clipped,
            rejected=none if self.schedule is None else self.schedule.rejected,
        )


def _run(
    envs: gym.vector.VectorEnv[Any, Any, Any],
    policy: Policy,
    p: Array,
    ticks: int,
    record: bool,
    evaluation: Evaluation,
) -> Episodes:
    """Episodes of one batch, as many as there are environments."""
    base: Any = envs.unwrapped
    observation, _ = envs.reset(options={"parameters": p, "extrapolate": True})
    state, schedule = None, None
    if isinstance(policy, PlanningPolicy):
        state = policy.start(p)
        schedule = policy.schedule(state) if evaluation == "schedule" else None
    starting = np.full(len(p), state is None)
    x = base.state
    log = _Log(base.problem, base.dt, ticks, x, base.context, schedule)
    states, controls = [x], []
    for tick in range(1, ticks + 1):
        if not log.open.any():
            break
        action, state = policy.predict(observation, state=state, episode_start=starting, deterministic=True)
        starting = np.zeros(len(p), bool)
        running = log.open.copy()
        observation, reward, terminated, _, _ = envs.step(action)
        following = base.state
        log.add(tick, x, following, -np.asarray(reward, dtype=np.float64), np.asarray(terminated))
        x = following
        if record:
            states.append(np.where(running[:, None], x, np.nan))
            controls.append(np.where(running[:, None], action, np.nan))
    episodes = log.episodes(p)
    if record:
        nu = base.problem.system.nu
        recorded = np.stack(controls, axis=1) if controls else np.empty((len(p), 0, nu))
        episodes = dataclasses.replace(episodes, states=np.stack(states, axis=1), controls=recorded)
    return episodes


def rollout(
    envs: gym.vector.VectorEnv[Any, Any, Any],
    policy: Policy,
    parameters: ArrayLike,
    *,
    horizon: float | None = None,
    record: bool = False,
    evaluation: Evaluation = "schedule",
) -> Episodes:
    """Run one episode for each row of ``parameters``, in batches of as many as there are environments.

    Args:
        envs: a vector environment of :mod:`ocp_envs` made with ``terminate_at_goal=False`` and
            ``autoreset_mode="Disabled"``, wrapped or not.
        policy: anything with ``predict``; a :class:`~moe_policy.protocols.PlanningPolicy` gets p in float64.
        parameters: (B, np) or (np,), inside the parameter box or not.
        horizon: seconds after which every episode is judged; at most the environment's time limit, its default.
        record: keep states and controls.
        evaluation: ``"schedule"``: a policy that plans is judged at the time it plans for; ``"goal"``: it is judged as
            one without a plan, so that its cost is what the environment charges up to the goal or the horizon, and
            what belongs to a plan is NaN.

    Raises:
        ValueError: an unknown ``evaluation``, an environment that restarts or ends at the goal by itself, a policy for
            another control period, a horizon beyond the time limit, parameters of another shape or not finite.
    """
    base: Any = envs.unwrapped
    problem: OptimalControlProblem = base.problem
    if evaluation not in get_args(Evaluation):
        raise ValueError(f"got evaluation={evaluation!r}, expected one of {', '.join(get_args(Evaluation))}")
    if base.settings.terminate_at_goal or base.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(
            f"{problem.id}: rollout needs an environment made with terminate_at_goal=False and "
            f'autoreset_mode="Disabled"; got {base.settings.terminate_at_goal} and {base.autoreset_mode.value!r}'
        )
    period = getattr(policy, "dt", None)
    if period is not None and not math.isclose(period, base.dt, rel_tol=1e-9):
        raise ValueError(
            f"{problem.id}: the policy was made for a control period of {period} s, the environment has {base.dt} s; "
            "make both with the same dt"
        )
    limit = base.settings.time_limit
    horizon = limit if horizon is None else horizon
    if not 0 < horizon <= limit:
        raise ValueError(f"{problem.id}: expected a horizon in (0, {limit}] s, the environment's limit; got {horizon}")
    p = problem.check_parameters(parameters, extrapolate=True)
    if len(p) == 0:
        raise ValueError(f"{problem.id}: expected parameters of at least one episode, got none")
    ticks, n = int(count_steps(horizon, base.dt)), envs.num_envs
    parts = []
    for first in range(0, len(p), n):
        batch = p[first : first + n]
        padded = np.concatenate([batch, np.repeat(batch[-1:], n - len(batch), axis=0)])
        parts.append(_run(envs, policy, padded, ticks, record, evaluation)[: len(batch)])
    return Episodes.concatenate(parts)
