"""The environments against those of other packages in the same run: Gymnasium's Pendulum-v1, crazyflow's quadrotor.

All are measured in turn on one core; a step of each is what its record says. crazyflow needs a Python environment of
its own, whose interpreter ``--crazyflow`` names: ``python -m venv peer && peer/bin/pip install crazyflow``. Writes
``benchmark_peers.json``.

    python scripts/benchmark_peers.py --crazyflow peer/bin/python
"""

import contextlib
from collections.abc import Sequence

import gymnasium as gym

from moe_policy.experiments import cli
from moe_policy.experiments.speed.peers import Contender, Measure, Peers, compared, crazyflow, ours, stepped, texts
from ocp_envs.envs.env import Env
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.support.provenance import provenance

#: Environments in a batch: of Gymnasium's, which steps one after another, and of crazyflow's.
PENDULUMS, QUADROTORS = 256, 4096
#: What was looked for as well, and is in no registry.
MISSING = {
    "gym-pybullet-drones": "No matching distribution found for gym-pybullet-drones",
    "safe-control-gym": "No matching distribution found for safe-control-gym",
}
_GYMNASIUM = f"Gymnasium {gym.__version__}, Pendulum-v1"
_STEP = "control step with one Euler step, observation and reward"


def main() -> None:
    parser = cli.parser(__doc__, env=None)
    parser.add_argument("--crazyflow", metavar="PYTHON", help="interpreter of an environment with crazyflow")
    parser.add_argument("--rounds", type=cli.positive, default=5, help="interleaved rounds; the median counts")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement; default 1")
    arguments = parser.parse()
    cli.one_core()

    often = (arguments.rounds, arguments.seconds)
    theirs = Contender(name=_GYMNASIUM, step=_STEP, dt=0.05)
    pendulum, batch = ours(PENDULUM, PENDULUMS)
    vector = gym.make_vec("Pendulum-v1", num_envs=PENDULUMS, vectorization_mode="sync")
    single = [
        ([pendulum], stepped(Env(PENDULUM), 1)),
        ([theirs], stepped(gym.make("Pendulum-v1").unwrapped, 1)),
    ]
    groups = {
        "pendulum, one": compared(single, 1, *often),
        "pendulum, vector": compared([([pendulum], batch), ([theirs], stepped(vector, PENDULUMS))], PENDULUMS, *often),
    }
    missing = dict(MISSING)
    with contextlib.ExitStack() as stack:
        own, measure = ours(QUADCOPTER, QUADROTORS)
        contenders: list[tuple[Sequence[Contender], Measure]] = [([own], measure)]
        if arguments.crazyflow is None:
            missing["crazyflow"] = "not measured: --crazyflow names no interpreter"
        else:
            try:
                contenders.append(stack.enter_context(crazyflow(arguments.crazyflow, QUADROTORS)))
            except (OSError, RuntimeError) as error:
                missing["crazyflow"] = str(error)
        groups["quadrotor, vector"] = compared(contenders, QUADROTORS, *often)
    for line in texts(groups):
        cli.say(line)
    cli.publish(arguments, "benchmark_peers", Peers(groups=groups, missing=missing, provenance=provenance()))


if __name__ == "__main__":
    cli.run(main)
