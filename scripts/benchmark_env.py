"""How fast the environments are: batched steps on one core, and a single step against Gymnasium's Pendulum-v1.

    python scripts/benchmark_env.py [--out results/benchmark_env.json]

Every figure is the best of several repetitions, in this process and on one core. At 4,096 environments the pendulum
must make at least 1,000,000 steps per second and the quadcopter 200,000, and a single step must take at most twice that
of Pendulum-v1.

Beside it stands what one to four Runge-Kutta steps in a tick cost and how accurate they are against SciPy's DOP853:
from random states under random controls in the whole operating box, and in its middle two thirds.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import ocp_envs
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.solvers.accuracy import integrate
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance, write_json
from ocp_envs.system import Box

REPETITIONS = 7
NUM_ENVS = 4096
#: Control period, seconds; where the choice of Runge-Kutta steps is shown, and on how many random states.
DT = 0.02
STUDIED, SUBSTEPS = (VEHICLE, QUADCOPTER), (1, 2, 3, 4)
SAMPLES, SEED = 5_000, 707
REGIONS = {"whole": 1.0, "middle": 2 / 3}


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


def tick_error(problem: OptimalControlProblem, substeps: int, share: float) -> dict[str, float]:
    """Norm of the error of a tick of ``DT`` seconds in the middle ``share`` of all boxes, in state units."""
    rng = np.random.default_rng(SEED)

    def draw(box: Box) -> Array:
        middle, half = box.centre, box.width / 2
        return middle + share * half * rng.uniform(-1, 1, (SAMPLES, len(box)))

    x, u, s = (draw(box) for box in (problem.system.state, problem.system.control, problem.context))
    h = np.full(SAMPLES, DT)
    exact = integrate(problem.batch_rate(), x, u, s, h)
    error = np.linalg.norm(problem.batch_flow(substeps)(x, u, s, h[:, None])[0] - exact, axis=1)
    return {"median": float(np.median(error)), "99_percent": float(np.quantile(error, 0.99)), "largest": error.max()}


def substeps_of(problem: OptimalControlProblem) -> list[dict[str, Any]]:
    """Rate and accuracy of an environment with one to four Runge-Kutta steps in a tick."""
    rows: list[dict[str, Any]] = []
    chosen = Simulator(problem, DT).substeps
    for substeps in SUBSTEPS:
        variant = dataclasses.replace(problem, longest_substep=DT / substeps)
        rows.append(
            {
                "substeps": substeps,
                "chosen": substeps == chosen,
                "steps_per_second": vector_rate(ocp_envs.VectorEnv(problem=variant, num_envs=NUM_ENVS), steps=20),
                "error": {region: tick_error(problem, substeps, share) for region, share in REGIONS.items()},
            }
        )
        whole = rows[-1]["error"]["whole"]
        print(
            f"{problem.id}, {substeps} steps a tick{' (chosen)' if substeps == chosen else ''}: "
            f"{rows[-1]['steps_per_second']:,.0f} steps/s, error {whole['median']:.1e} (median), "
            f"{whole['99_percent']:.1e} (99 %), {whole['largest']:.1e} (largest)"
        )
    return rows


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

    record = {
        "num_envs": NUM_ENVS,
        "steps_per_second": rates,
        "single_step_microseconds": single,
        "substeps": {problem.id: substeps_of(problem) for problem in STUDIED},
    }
    write_json(arguments.out, {**record, "provenance": provenance()})
    print(f"wrote {arguments.out}")


if __name__ == "__main__":
    main()
