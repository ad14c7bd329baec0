"""The planners of a benchmark over several training seeds, ablations, and success against training size.

Every trained model is evaluated on the validation set. Runs are spread over the cores, each result is kept under
``data/compare_training/``, and within a run the state of every network once a minute: an interrupted command continues
where it stopped. Needs the databases of ``scripts/generate_data.py``. Writes ``compare_training_<env>.json`` and the
figures of the problem.

    python scripts/compare_training.py --env GroundVehicle-v0 --seeds 3
"""

import argparse
import dataclasses
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from moe_policy.experiments import cli, trainings
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.benchmark.parts import Benchmark
from moe_policy.experiments.figures import gallery
from moe_policy.experiments.figures.comparison import sizes_figure
from moe_policy.experiments.figures.details import Details
from moe_policy.experiments.seeds import Model, Paper, TrainingComparison, TrainingRow
from moe_policy.experiments.trainings import Folders, Run
from moe_policy.learning.architectures import PAPER_SIZES, Hidden
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import ABSENT
from moe_policy.store import SHIPPED, load_file
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.provenance import provenance


@dataclass(frozen=True)
class Trained:
    """All trained models of a problem, as rows over their seeds."""

    problem: OptimalControlProblem
    benchmark: Benchmark
    models: dict[Run, Model]
    total: int  # number of instances in the training set

    def _row(
        self, name: str, samples: int | None, settings: TrainingSettings | None, hidden: Hidden | None = None
    ) -> list[TrainingRow]:
        """The row of one kind of run; empty where no model is kept."""
        kind = (name, samples, settings, hidden)
        runs = [run for run in self.models if (run.name, run.samples, run.settings, run.hidden) == kind]
        models = [self.models[run] for run in sorted(runs, key=lambda run: run.seed)]
        return [TrainingRow.of(name, models)] if models else []

    def _on_all(self, name: str) -> list[TrainingRow]:
        """The row of the models that were trained on all instances, where others use fewer."""
        whole = max((run.samples for run in self.models if run.samples > self.total), default=None)
        return self._row(name, whole, self.benchmark.training.whole.get(name))

    def rows(self) -> list[TrainingRow]:
        """The models of the benchmark, then those on fewer instances, then those with the paper's settings."""
        rows, fewer, training = [], [], self.benchmark.training
        for name in self.benchmark.planners.trained:
            usual, largest = self._row(name, self.total, training.settings), self._on_all(name)
            rows += [row.with_paper(self.benchmark.published.get(name)) for row in largest or usual]
            fewer += [replace(row, name=f"{name}, {self.total:,} problems") for row in usual if largest]
        papers = [row for name in training.paper for row in self._row(name, self.total, trainings.PAPER)]
        return [*rows, *fewer, *(replace(row, name=f"{row.name}, the paper's training settings") for row in papers)]

    def ablation(self) -> list[TrainingRow]:
        """Single networks by their hidden layers."""
        usual, settings = PAPER_SIZES[self.problem.id].single, self.benchmark.training.settings
        return [
            replace(row, hidden=tuple(hidden), paper=Paper(test_error=error))
            for hidden, error in self.benchmark.training.depths.items()
            for row in self._row("snn", self.total, settings, None if hidden == usual else hidden)
        ]

    def sizes(self) -> list[TrainingRow]:
        """Models by the number of training instances."""
        counts = trainings.sizes_of(self.benchmark, self.total)
        sized = self.benchmark.training.sized
        return [row for n in sized for row in (*(r for size in counts for r in self._row(n, *size)), *self._on_all(n))]


def draw(
    problem: OptimalControlProblem, folders: Folders, models: dict[str, Path], results: Path, sizes: list[TrainingRow]
) -> Details:
    """Draw the figures from the ``models`` of the first seed (paths by name) and the rows of several ``sizes``."""
    stem = results / f"training_{problem.id}"
    training, validation = (folders.samples(problem, name) for name in ("training", "validation"))
    planners = {name: load_file(path, problem, kind=NetworkPlanner) for name, path in models.items()}
    partitions = tuple(int(name.rsplit("-", 1)[1]) for name in models if name.startswith("moe-kmeans-"))
    material = gallery.Material(training, validation, planners, partitions)
    if len({row.samples for row in sizes}) > 1:
        sizes_figure(f"{stem}_sizes.png", sizes, len(validation))
    drawings = gallery.drawings(problem)
    found: dict[str, Any] = {name: d.draw(material, Path(f"{stem}_{name}.png")) for name, d in drawings.items()}
    return Details(**{name: details for name, details in found.items() if details is not None})


def parse_arguments() -> argparse.Namespace:
    ship = "write into results/ instead of runs/, and put the models of the first seed into the package"
    parser = cli.parser(__doc__, data=True, workers=True, ship=ship)
    parser.add_argument("--seeds", metavar="N", type=cli.positive, default=5, help="training seeds of every model")
    parser.add_argument(
        "--names",
        metavar="NAME",
        nargs="+",
        help="train these alone, such as moe-auto with --over-seeds; with --ship the results are of the kept models",
    )
    parser.add_argument(
        "--over-seeds",
        action="store_true",
        help="only train the networks that scripts/compare_splits.py --seeds compares",
    )
    return parser.parse()


def main() -> None:
    arguments = parse_arguments()
    cli.threads()
    began, problem = time.perf_counter(), arguments.problem
    folders = Folders(arguments.data / problem.id, arguments.data / "compare_training" / problem.id)
    training, benchmark = cli.database(arguments, "training"), benchmark_of(problem)
    if arguments.over_seeds:
        equal = trainings.over_seeds(training, arguments.seeds, arguments.names)
        trainings.train_all(problem, {run: run.key(training.key) for run in equal}, folders, arguments.workers)
        return
    total = len(training.solved(training.first(benchmark.training.instances)))
    largest = list(trainings.planned_on_all(training, total))
    cli.database(arguments, "validation")  # for the evaluation; trainings would end without it
    runs = {run: run.key(training.key) for run in (*largest, *trainings.planned(problem, arguments.seeds, total))}
    models = trainings.execute_all(problem, runs, folders, arguments.workers, arguments.names)
    if arguments.names is not None and not arguments.ship:
        return
    trained, settings = Trained(problem, benchmark, models, total), benchmark.training.settings
    first = {name: Run(name, 0, total, settings) for name in benchmark.planners.trained}
    first |= {run.name: run for run in largest if run in models}
    paths = {name: folders.model(runs[run]) for name, run in first.items() if "pca" not in name}
    if arguments.ship:
        for name in benchmark.shipped:
            planner = load_file(paths[name], problem, kind=NetworkPlanner)
            planner.rounded().save(SHIPPED / problem.id / name)
    rows, sizes = trained.rows(), trained.sizes()
    record = TrainingComparison(
        settings=dataclasses.asdict(settings),
        whole={name: dataclasses.asdict(found) for name, found in benchmark.training.whole.items()} or ABSENT,
        rows=tuple(rows),
        ablation=tuple(trained.ablation()),
        sizes=tuple(sizes),
        figures=draw(problem, folders, paths, arguments.results, sizes),
        env_id=problem.id,
        training_key=training.key,
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )
    cli.publish(arguments, f"compare_training_{problem.id}", record)
    for row in rows:
        cli.say(f"{row.name:45s} {row.success_spread.median:6.0f} {row.success_at_plan_end_spread.median:6.0f}")


if __name__ == "__main__":
    cli.run(main, continues=True)
