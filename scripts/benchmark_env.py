"""How fast the environments are: batched steps on one core, and a single step against Gymnasium's Pendulum-v1.

    python scripts/benchmark_env.py            # writes benchmark_env.json

Every value is the best of several repetitions, in this process and on one core. The aim, at 4,096 environments, is
12,000,000 steps per second of the pendulum, 8,000,000 of the vehicle and 1,800,000 of the quadcopters, and a single
step that takes at most twice as long as one of Pendulum-v1.

The record also compares one to four Runge-Kutta steps in a control step: their rate, and their error against SciPy's
DOP853, from random states under random controls in the whole operating box and in its middle two thirds; and compiled
kernels with CasADi's interpreter.
"""

import gymnasium as gym

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.speed.environments import (
    EnvironmentSpeed,
    SingleStep,
    kernels_of,
    single_step,
    substeps_of,
    vector_rate,
)
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.provenance import provenance

REPETITIONS = 7
NUM_ENVS = 4096
#: Problems whose choice of Runge-Kutta steps is shown.
STUDIED = (VEHICLE, QUADCOPTER)


def main() -> None:
    arguments = cli.parser(__doc__, env=None).parse()
    rates = {}
    for name in ocp_envs.names():
        rates[name] = vector_rate(VectorEnv(name, NUM_ENVS), 50, REPETITIONS)
        cli.say(f"{name}: {rates[name]:,.0f} steps/s with {NUM_ENVS:,} environments on one core")
    kernels = {}
    for name in ocp_envs.names():
        kernels[name] = kernels_of(ocp_envs.load(name), NUM_ENVS, 3 * REPETITIONS)
        for row in kernels[name]:
            speed = f"{row.rows_per_second:,.0f} rows/s, {row.ratio:.1f} × CasADi's interpreter"
            cli.say(f"{name}, {row.function}: {speed}")
    single = {}
    for how, strip in (("with gym.make's wrappers", False), ("unwrapped", True)):
        pair = [gym.make(name) for name in (PENDULUM.id, "Pendulum-v1")]
        ours, theirs = (single_step(env.unwrapped if strip else env, repetitions=REPETITIONS) for env in pair)
        single[how] = SingleStep(ours=ours, theirs=theirs, ratio=ours / theirs)
        cli.say(f"one step, {how}: {ours:.2f} µs; Pendulum-v1 {theirs:.2f} µs; ratio {ours / theirs:.2f}")
    substeps = {}
    for problem in STUDIED:
        substeps[problem.id] = substeps_of(problem, NUM_ENVS, REPETITIONS)
        cli.say("\n".join(f"{problem.id}, {row.text()}" for row in substeps[problem.id]))
    record = EnvironmentSpeed(
        num_envs=NUM_ENVS,
        steps_per_second=rates,
        kernels=kernels,
        single_step_microseconds=single,
        substeps=substeps,
        provenance=provenance(),
    )
    cli.publish(arguments, "benchmark_env", record)


if __name__ == "__main__":
    cli.run(main)
