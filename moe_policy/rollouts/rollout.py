"""Closed-loop episodes of any policy from given parameters.

    reached    the state entered the goal ball ‖x − goal‖ < radius initially or at the end of some control step
    success    the state was in the goal ball at the evaluation time
    cost       ∫L dt up to the first entry, or of the whole episode where there is none

The evaluation time of a policy that plans is known in advance (see :class:`moe_policy.protocols.PlanningPolicy`); where
it plans again, that of the last plan counts. Any
other policy, and any with ``evaluation="goal"``, is evaluated ``problem.hold`` seconds after the first entry, at the
latest at the horizon. An episode ends when it is evaluated or when it leaves the operating box, which the environment
charges and which is never a success. All results are those of the simulator: no wrapper changes them, except
by changing the controls. It warns of NaN among the controls of a policy.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Literal, cast, get_args

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike

from moe_policy.control.policy import act
from moe_policy.protocols import ExactPolicy, PlanningPolicy, Policy
from moe_policy.rollouts.environments import Environments, base_of
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.ledger import Ledger
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.clock import count_steps
from ocp_envs.support.doors import checked

#: What determines the evaluation time: the plan's schedule, or the first entry into the goal ball.
Evaluation = Literal["schedule", "goal"]


@checked
def rollout(
    envs: Environments,
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
            ``autoreset_mode="Disabled"``, wrapped or not; :func:`moe_policy.environments` makes them.
        policy: anything with ``predict``; a :class:`~moe_policy.protocols.PlanningPolicy` gets p in float64, and
            an :class:`~moe_policy.protocols.ExactPolicy` acts in float64.
        parameters: (B, np) or (np,), inside the parameter box or not.
        horizon: seconds after which every episode is evaluated; at most the environment's time limit, its default.
        record: keep the states, and the controls as the environment of :mod:`ocp_envs` gets them.
        evaluation: ``"schedule"``: a policy that plans is evaluated at the time it plans for; ``"goal"``: it is
            evaluated as one without a plan, so that its cost is what the environment charges up to the goal or the
            horizon, and what belongs to a plan is NaN.

    Raises:
        TypeError: another vector environment than one of :mod:`ocp_envs`.
        RuntimeError: another thread is using the environments.
        ValueError: an unknown ``evaluation``, an environment that restarts or ends at the goal by itself, a wrapper
            that does not take exactly one control step in a step, a policy that is not made for such environments, a
            horizon beyond the time limit, parameters of another shape or not finite.
    """
    base = base_of(envs)
    _check(base, policy, evaluation)
    if isinstance(policy, ExactPolicy):
        policy.check(envs)
    steps = _steps(base, horizon)
    p = base.problem.check_parameters(parameters, extrapolate=True)
    if len(p) == 0:
        raise ValueError(f"{base.problem.id}: expected parameters of at least one episode, got none")
    parts, size = [], base.num_envs
    with base.reserved():
        for first in range(0, len(p), size):
            batch = p[first : first + size]
            filled = np.concatenate([batch, np.repeat(batch[-1:], size - len(batch), axis=0)])
            parts.append(_run(envs, policy, filled, steps, record, evaluation)[: len(batch)])
    return Episodes.concatenate(parts)


def _run(envs: Environments, policy: Policy, p: Array, steps: int, record: bool, evaluation: Evaluation) -> Episodes:
    """Episodes of one batch, as many as there are environments, of at most ``steps`` control steps."""
    base = base_of(envs)
    observation, _ = envs.reset(options={"parameters": p, "extrapolate": True})
    state, schedule = None, None
    if isinstance(policy, PlanningPolicy):
        state = policy.start(p)
        schedule = policy.schedule(state) if evaluation == "schedule" else None
    step, begins, x = 0, np.full(len(p), state is None), base.state
    ledger = Ledger(base.problem, base.dt, steps, x, base.context, schedule)
    states, controls, nan = [x], [], np.zeros(len(p), bool)
    while ledger.running.any():
        step, running = step + 1, ledger.running.copy()
        action, state = act(policy, observation, state, begins)
        if schedule is not None and (renewed := cast(PlanningPolicy, policy).schedule(state)) is not schedule:
            assert renewed is not None
            schedule = renewed
            ledger.reschedule(schedule)
        observation, _, _, _, _ = envs.step(action)
        _check_steps(base, step, running)
        nan |= running & np.isnan(base.controls).any(axis=1)
        # The simulator's own results: a wrapper may change rewards, actions, observations and the ends of episodes.
        begins, before, x = np.zeros(len(p), bool), x, base.state
        ledger.add(step, before, x, base.costs, base.left_box)
        if record:
            states.append(np.where(running[:, None], x, np.nan))
            controls.append(np.where(running[:, None], base.controls, np.nan))
    _report_nan(base, nan)
    episodes = ledger.episodes(p)
    if record:
        applied = np.stack(controls, axis=1) if controls else np.empty((len(p), 0, base.problem.system.nu))
        episodes = replace(episodes, states=np.stack(states, axis=1), controls=applied)
    return episodes


def _report_nan(base: VectorEnv, rows: Bools) -> None:
    if rows.any():
        warnings.warn(
            f"{base.problem.id}: the policy returned NaN in {np.count_nonzero(rows)} of {len(rows)} episodes; in these "
            "control steps the control that holds the goal acted",
            stacklevel=4,
        )


def _check(base: VectorEnv, policy: Policy, evaluation: Evaluation) -> None:
    name, period = base.problem.id, getattr(policy, "dt", None)
    if evaluation not in get_args(Evaluation):
        raise ValueError(f"got evaluation={evaluation!r}, expected one of {', '.join(get_args(Evaluation))}")
    if base.options.terminate_at_goal or base.autoreset_mode is not AutoresetMode.DISABLED:
        got = f"{base.options.terminate_at_goal} and {base.autoreset_mode.value!r}"
        raise ValueError(f'{name}: rollout needs terminate_at_goal=False and autoreset_mode="Disabled"; got {got}')
    if period is not None and not math.isclose(period, base.dt, rel_tol=1e-9):
        raise ValueError(f"{name}: got a policy for {period} s in environments of {base.dt} s, expected the same dt")


def _check_steps(base: VectorEnv, step: int, running: Bools) -> None:
    """Refuse wrappers that take no or several control steps in one, or that reset episodes."""
    taken = base.steps[running]
    if (taken != step).any():
        raise ValueError(
            f"{base.problem.id}: a step of the wrapped environments must be one control step of {base.dt} s; after "
            f"{step} of them an episode is at control step {taken[taken != step][0]}. Run the rollout without the "
            "wrapper that repeats actions or resets episodes, or make the environments with a longer dt"
        )


def _steps(base: VectorEnv, horizon: float | None) -> int:
    """Control steps of the longest episode."""
    limit = base.options.time_limit or base.problem.time_limit
    horizon = limit if horizon is None else horizon
    if not 0 < horizon <= limit:
        raise ValueError(f"{base.problem.id}: expected a horizon in (0, {limit}] s, the time limit; got {horizon}")
    return int(count_steps(horizon, base.dt))
