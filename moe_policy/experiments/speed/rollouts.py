"""Speed of batched rollouts against a loop over single environments."""

from __future__ import annotations

import time
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.records import Record
from moe_policy.protocols import Planner
from moe_policy.rollouts.rollout import rollout
from ocp_envs.envs.env import Env
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.provenance import Provenance

#: Control period, seconds.
DT = 0.02


@dataclass(frozen=True, kw_only=True)
class Batched(Record):
    """Seconds of a batched rollout: of all plans, of the gains along them, and of the whole."""

    planning: float
    tracking_setup: float
    whole: float


@dataclass(frozen=True, kw_only=True)
class RolloutSpeed(Record):
    """Batched rollouts of one planner against episodes one by one: medians over ``repeats`` interleaved runs.

    ``ratio``: time of an episode alone / its time in the batch.
    """

    env_id: str
    planner: str
    episodes: int
    dt: float
    seed: int
    repeats: int
    successes: int
    batched_seconds: Batched
    batched_seconds_per_episode: float
    single_episodes: int
    single_seconds_per_episode: float
    ratio: float
    same_successes: bool
    provenance: Provenance


def batched(problem: OptimalControlProblem, planner: Planner, p: Array) -> tuple[Batched, Bools]:
    """Times of a batched rollout from ``p`` (B, np), and its successes (B,)."""
    began = time.perf_counter()
    planner(p)
    planned = time.perf_counter()
    policy = TrackingPolicy(problem, planner, DT)
    policy.start(p)
    started = time.perf_counter()
    envs = gym.make_vec(problem.id, num_envs=len(p), dt=DT, terminate_at_goal=False, autoreset_mode="Disabled")
    whole = time.perf_counter()
    episodes = rollout(envs, TrackingPolicy(problem, planner, DT), p)
    ended = time.perf_counter()
    planning = planned - began
    times = Batched(planning=planning, tracking_setup=started - planned - planning, whole=ended - whole)
    return times, episodes.success


def one_by_one(problem: OptimalControlProblem, planner: Planner, p: Array) -> tuple[float, Bools]:
    """Seconds of a loop over single environments from ``p`` (B, np), and its successes (B,)."""
    began = time.perf_counter()
    policy = TrackingPolicy(problem, planner, DT)
    env = Env(problem, dt=DT, terminate_at_goal=False)
    success = []
    for parameter in p:
        observation, _ = env.reset(options={"parameters": parameter})
        state = policy.start(parameter)
        for _ in range(round(float(policy.schedule(state).evaluation[0]) / DT)):
            action, state = policy.predict(observation, state)
            observation, _, terminated, _, info = env.step(action)
            if terminated:
                break
        success.append(info["is_success"] and not terminated)
    return time.perf_counter() - began, np.array(success)
