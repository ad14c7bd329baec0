"""How fast the environments are: batched steps on one core, and a single step against Gymnasium's Pendulum-v1.

    python scripts/benchmark_env.py [--out results/benchmark_env.json]

Every figure is the best of several repetitions, in this process and on one core. The pendulum must make at least
1,000,000 steps per second at 4,096 environments, and a single step must take at most twice that of Pendulum-v1.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym

import ocp_envs
from ocp_envs.records import provenance, write_json

REPETITIONS = 7
NUM_ENVS = 4096


def best_time(run: Callable[[], None]) -> float:
    """Shortest duration of ``run`` in seconds."""
    durations = []
    for _ in range(REPETITIONS):
        begin = time.perf_counter()
        run()
        durations.append(time.perf_counter() - begin)
    return min(durations)


def vector_rate(envs: gym.vector.VectorEnv[Any, Any, Any], steps: int) -> float:
    """Environment steps per second."""
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = envs.action_space.sample()

    def run() -> None:
        for _ in range(steps):
            envs.step(actions)

    run()
    return envs.num_envs * steps / best_time(run)


def single_step(env: gym.Env[Any, Any], steps: int = 5000) -> float:
    """Microseconds per step, resets included."""
    env.reset(seed=0)
    env.action_space.seed(0)
    action = env.action_space.sample()

    def run() -> None:
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    run()
    return best_time(run) / steps * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="results/benchmark_env.json", help="where the record goes")
    arguments = parser.parse_args()

    rates = {}
    for name in ocp_envs.names():
        rates[name] = vector_rate(gym.make_vec(name, num_envs=NUM_ENVS), steps=50)
        print(f"{name}: {rates[name]:,.0f} steps/s at {NUM_ENVS:,} environments on one core")

    single = {}
    for how, strip in (("with gym.make's wrappers", False), ("unwrapped", True)):
        pair = [gym.make(name) for name in ("PendulumSwingup-v0", "Pendulum-v1")]
        ours, theirs = (single_step(env.unwrapped if strip else env) for env in pair)
        single[how] = {"PendulumSwingup-v0": ours, "Pendulum-v1": theirs, "ratio": ours / theirs}
        print(f"one step, {how}: {ours:.2f} µs; Pendulum-v1 {theirs:.2f} µs; ratio {ours / theirs:.2f}")

    record = {"num_envs": NUM_ENVS, "steps_per_second": rates, "single_step_microseconds": single}
    write_json(arguments.out, {**record, "provenance": provenance()})
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
