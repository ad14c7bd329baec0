"""Time the rollout of 1,000 tracked pendulum plans, planning and LQR included, against a loop over single episodes.

Both sides use the same shipped planner, the same tracking policy and the same starts. The alternative is what one
writes without batching: plan, compute the gains and step one ``gymnasium.make`` environment at a time. It runs on fewer
episodes, and the times per episode are compared.

    python scripts/benchmark_rollout.py
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import moe_policy
import ocp_envs
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.protocols import Planner
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.provenance import provenance, write_json

RESULTS = Path(__file__).resolve().parents[1] / "results"
DT = 0.02


def draw(problem: OptimalControlProblem, count: int, seed: int) -> Array:
    box = problem.parameters
    return np.random.default_rng(seed).uniform(box.lower, box.upper, (count, len(box)))


def batched(problem: OptimalControlProblem, planner: Planner, p: Array) -> tuple[dict[str, float], Bools]:
    """Seconds of each part and of the whole, policy and gains included; and the successes (B,)."""
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
    return {
        "planning": planning,
        "tracking_setup": started - planned - planning,
        "whole": ended - whole,
    }, episodes.success


def one_by_one(problem: OptimalControlProblem, planner: Planner, p: Array) -> tuple[float, Bools]:
    """Seconds of the whole, and the successes, with one environment and one episode at a time."""
    began = time.perf_counter()
    policy = TrackingPolicy(problem, planner, DT)
    env: Any = gym.make(problem.id, dt=DT, terminate_at_goal=False).unwrapped
    success = []
    for parameter in p:
        observation, _ = env.reset(options={"parameters": parameter})
        state = policy.start(parameter)
        for _ in range(round(float(policy.schedule(state).judging[0]) / DT)):
            action, state = policy.predict(observation, state)
            observation, _, terminated, _, info = env.step(action)
            if terminated:
                break
        success.append(info["is_success"] and not terminated)
    return time.perf_counter() - began, np.array(success)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the problem")
    parser.add_argument("--planner", default="moe-custom", help="name of a shipped planner")
    parser.add_argument("--episodes", type=int, default=1000, help="episodes of the batched rollout")
    parser.add_argument("--single", type=int, default=20, help="episodes of the loop over single environments")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each, interleaved; the median counts")
    parser.add_argument("--seed", type=int, default=0, help="seed of the starts")
    parser.add_argument("--output", type=Path, help="results/benchmark_rollout_<env-id>.json by default")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    output = arguments.output or RESULTS / f"benchmark_rollout_{problem.id}.json"
    planner = moe_policy.load(arguments.env, arguments.planner)
    p = draw(problem, arguments.episodes, arguments.seed)
    runs, singles, agreement = [], [], []
    for _ in range(arguments.repeats):
        seconds, success = batched(problem, planner, p)
        taken, single_success = one_by_one(problem, planner, p[: arguments.single])
        runs.append(seconds)
        singles.append(taken / arguments.single)
        agreement.append(bool(np.array_equal(success[: arguments.single], single_success)))
    median = {part: statistics.median(run[part] for run in runs) for part in runs[0]}
    per_episode = median["whole"] / arguments.episodes
    result = {
        "problem": problem.id,
        "planner": arguments.planner,
        "episodes": arguments.episodes,
        "dt": DT,
        "seed": arguments.seed,
        "repeats": arguments.repeats,
        "successes": int(success.sum()),
        "batched_seconds": median,
        "batched_seconds_per_episode": per_episode,
        "single_episodes": arguments.single,
        "single_seconds_per_episode": statistics.median(singles),
        "ratio": statistics.median(singles) / per_episode,
        "same_successes": all(agreement),
        "provenance": provenance(),
    }
    write_json(output, result)
    print(f"{arguments.episodes} tracked plans, batched: {median['whole']:.2f} s", end=" ")
    print(f"(planning {median['planning']:.3f} s and tracking set-up {median['tracking_setup']:.2f} s of it)")
    single = 1e3 * statistics.median(singles)
    print(f"one environment at a time: {single:.1f} ms an episode, {result['ratio']:.0f} times as long")
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
