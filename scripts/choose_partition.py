"""Compare ways to split a steep family of optimal trajectories between experts, on the development set.

Mixtures over all partitions are trained on the instances and with the epochs with which
``scripts/compare_training.py --over-seeds`` trains the compared networks, which are evaluated as well. Needs these
networks and the database ``training``. Results are kept under ``data/choose_partition/``: an interrupted command
continues where it stopped. Writes ``partitions_<env>.json``.

    python scripts/choose_partition.py --env QuadcopterObstacle-v0
"""

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments import cli, trainings
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import run
from moe_policy.experiments.partitions import (
    PARTITION_COLUMNS,
    PartitionModel,
    PartitionRow,
    Partitions,
    partition,
)
from moe_policy.experiments.seeds import Training
from moe_policy.learning.clustering import Labels
from moe_policy.learning.recipes import TOGETHER
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import ABSENT, present, read, write
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from ocp_envs.data.samples import Samples
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance

#: Partitions and their numbers of parts.
COMPARED = (
    ("custom", 8),
    ("kmeans", 8),
    ("cuts", 8),
    ("residuals", 8),
    ("competition", 8),
    ("reaction", 8),
    ("reaction", 16),
)


@dataclass(frozen=True, eq=False)
class Trial:
    """The training of mixtures over partitions of ``samples``."""

    samples: Samples
    settings: TrainingSettings
    development: Array  # initial conditions, (B, np)
    kept: Path  # folder of results

    def row(self, name: str, k: int, seeds: int) -> PartitionRow:
        """The row of the partition ``name`` into ``k`` parts, over ``seeds`` seeds."""
        path, began = self.kept / f"{name}-{k}.npz", time.perf_counter()
        if not path.exists():
            values = partition(self.samples, name, k, self.settings).values
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savez(path, values=values, seconds=time.perf_counter() - began)
        with np.load(path) as found:
            values, seconds = found["values"], float(found["seconds"])
        labels = Labels(values, tuple(map(str, range(values.max() + 1))), name)
        return PartitionRow.of([self._model(labels, k, seed) for seed in range(seeds)], seconds)

    def _model(self, labels: Labels, k: int, seed: int) -> PartitionModel:
        path = self.kept / f"{labels.method}-{k}-s{seed}.json"
        if not path.exists():
            planner = fit_mixture(self.samples, labels, settings=self.settings, seed=seed, together=TOGETHER)
            write(path, self.evaluated(planner, labels.method, TOGETHER))
        model = read(path, PartitionModel)
        cli.say(f"{labels.method}-{k}, seed {seed}: {model.metrics}")
        return model

    def evaluated(self, planner: NetworkPlanner, name: str, together: float) -> PartitionModel:
        """The ``planner`` over the partition ``name`` on the development set."""
        row, _ = run(planner.problem, Method(name, planner), self.development, batches=())
        training = Training.of(planner)
        return PartitionModel(
            name=name,
            together=together,
            seed=training.seed,
            sizes=tuple(planner.details.get("clusters", {}).get("sizes", ())),
            gate_accuracy=present(training.gate_accuracy),
            test_error=training.test_error,
            training_seconds=training.training_seconds,
            metrics=PartitionModel.values(row.metrics),
        )

    def others(self, networks: dict[trainings.Run, NetworkPlanner]) -> Iterator[PartitionRow]:
        """The rows of the compared networks of other experiments, by name."""
        for name in dict.fromkeys(one.name for one in networks):
            planners = [planner for one, planner in networks.items() if one.name == name]
            yield PartitionRow.of([self.evaluated(planner, name, 0.0) for planner in planners], ABSENT)


def main() -> None:
    parser = cli.parser(__doc__, env="QuadcopterObstacle-v0", data=True, cases="development instances")
    parser.add_argument("--seeds", metavar="N", type=cli.positive, default=3, help="training seeds of every partition")
    arguments = parser.parse()
    cli.threads()
    problem, benchmark = arguments.problem, benchmark_of(arguments.problem).training
    if benchmark.over_seeds is None:
        parser.error(f"no trainings over seeds are declared for {problem.id}")
    database = cli.database(arguments, "training")
    first, epochs = benchmark.over_seeds
    settings = dataclasses.replace(benchmark.settings, epochs=epochs)
    samples = database.samples(database.first(first))
    development = sets_of(problem).development.parameters(problem, arguments.cases)
    trial = Trial(samples, settings, development, arguments.data / "choose_partition" / problem.id)
    rows = list(trial.others(trainings.networks(problem, arguments.data, arguments.seeds)))
    rows += [trial.row(name, k, arguments.seeds) for name, k in COMPARED]
    record = Partitions(
        env_id=problem.id,
        split="development",
        cases=len(development),
        samples=len(samples),
        settings=dataclasses.asdict(settings),
        rows=tuple(rows),
        training_key=database.key,
        provenance=provenance(),
    )
    cli.publish(arguments, f"partitions_{problem.id}", record)
    print(text_table(record.rows, PARTITION_COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
