"""Where the time of training goes: the parts of an epoch, and what a second thread or a second process gains.

The single network of each problem is trained on random data, since the time does not depend on them. Writes
``benchmark_training.json``.

    python scripts/benchmark_training.py
"""

import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.speed.training import TrainingSpeed, training_row
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, env=None)
    parser.add_argument("--samples", type=cli.positive, default=20_000, help="samples of an epoch; default 20000")
    parser.add_argument("--epochs", type=cli.positive, default=3, help="epochs that are measured; the median counts")
    arguments = parser.parse()

    rows = []
    with WorkerPool(2) as two:
        for name in ocp_envs.names():
            row = training_row(ocp_envs.load(name), arguments.samples, arguments.epochs, two)
            rows.append(row)
            parts = ", ".join(f"{part} {fraction:.0%}" for part, fraction in row.fraction.items())
            gains = ", ".join(f"{ratio:.2f} with {how}" for how, ratio in row.ratio.items())
            cli.say(f"{row.env_id}: {row.samples_per_second:,.0f} samples/s ({parts}); {gains}")
    record = TrainingSpeed(
        samples=arguments.samples, epochs=arguments.epochs, rows=tuple(rows), provenance=provenance()
    )
    cli.publish(arguments, "benchmark_training", record)


if __name__ == "__main__":
    cli.run(main)
