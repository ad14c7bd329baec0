"""Steps per second of crazyflow on the CPU, as a program for an environment of its own, in which it is installed.

    python crazyflow_steps.py 4096

It prints its version, then answers each line of its input, the seconds of a measurement, with the rates of a step of
its Gymnasium environment ``DroneReachPos-v0`` and of one time step of its simulator with first-principles dynamics.
Both are steps of 2 ms.
"""

import importlib
import os
import sys
import time
from typing import Any


def rate(step: Any, rows: int, seconds: float) -> float:
    """Steps per second of ``rows`` rows in calls of ``step``, whose results it waits for."""
    jax = importlib.import_module("jax")
    calls, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        jax.block_until_ready(step())
        calls += 1
    return calls * rows / (time.perf_counter() - began)


def main(rows: int) -> None:
    """Measure ``rows`` drones."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    crazyflow = importlib.import_module("crazyflow")
    gym = importlib.import_module("gymnasium")
    numpy = importlib.import_module("numpy")
    envs = gym.make_vec("DroneReachPos-v0", num_envs=rows)
    envs.reset(seed=0)
    actions = envs.action_space.sample()
    sim = crazyflow.Sim(
        n_worlds=rows, dynamics=crazyflow.Dynamics.first_principles, control=crazyflow.Control.rotor_vel
    )
    sim.rotor_vel_control(numpy.full((rows, 1, 4), 15_000.0, numpy.float32))

    def simulate() -> Any:
        sim.step(1)
        return sim.data.states.pos

    steps = (lambda: envs.step(actions)[:4], simulate)
    for _ in range(3):  # compiles, again after the first step
        for step in steps:
            rate(step, rows, 1.0)
    print(crazyflow.__version__, file=answers, flush=True)
    for line in sys.stdin:
        print(*(rate(step, rows, float(line)) for step in steps), file=answers, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
