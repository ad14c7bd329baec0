"""The paper's tables and figures, each by name, ours next to the paper's.

    python scripts/reproduce.py --all --quick
    python scripts/reproduce.py --table summary
    python scripts/reproduce.py --figure vehicle-histories quadcopter-obstacle-flip --quick

``--quick`` evaluates the shipped networks on a few validation instances, and draws from a few training instances; both
are solved at once, under ``data/reproduce``. Without it everything is made from nothing by the scripts of the pipeline,
``generate_data.py`` and ``compare_training.py``, which takes hours; an interrupted run continues. Tables are printed
and go to ``table_<name>.json`` and ``.md``, figures to ``figure_<name>.png``, ``.pdf`` and ``.json``, with ``--quick``
in the folder ``quick`` of the results. ``--list`` prints all names.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import moe_policy
import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.checking import checked_row
from moe_policy.experiments.comparison import Comparison
from moe_policy.experiments.figures import gallery
from moe_policy.experiments.figures.details import Figure
from moe_policy.experiments.figures.sketch import mixture_figure
from moe_policy.experiments.learners import learner_trainings
from moe_policy.experiments.overview import FOUND, OVERVIEW_COLUMNS, OverviewTable, Sources, overview_rows
from moe_policy.experiments.paper_tables import (
    TRAINING_COLUMNS,
    Source,
    SummaryTable,
    TrainingTable,
    summarised,
    summary,
    summary_columns,
)
from moe_policy.experiments.seeds import Model, Training, TrainingComparison, TrainingRow
from moe_policy.experiments.splits import SplitComparison, uniform_row
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import ABSENT, Record, present, read, write
from moe_policy.reports.tables import markdown_table
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import PAPER
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import provenance

#: The paper's table of ways to train is about the pendulum.
TRAINED = PENDULUM.id
#: A sketch, the paper's second figure, belongs to no problem.
SKETCH = "mixture"
#: Initial conditions of the comparisons of the quick form.
COMPARED = 200


def figure_names() -> dict[str, tuple[OptimalControlProblem, str]]:
    """Problem and drawing of every figure by its name."""
    drawn = [(problem, kind) for problem in PAPER for kind in gallery.drawings(problem)]
    return {f"{benchmark_of(problem).short}-{kind}": (problem, kind) for problem, kind in drawn}


@dataclass(frozen=True, eq=False)
class Made:
    """What the tables and figures of one problem are made from, itself made where it is missing."""

    problem: OptimalControlProblem
    quick: bool  # from few instances, and shipped networks
    data: Path  # folder of the databases of all problems
    results: Path
    workers: int | None

    def _database(self, name: str) -> ocp_envs.Database:
        problem = self.problem
        if not self.quick:
            return ocp_envs.Database.open(self.data / problem.id / f"{name}.zarr", problem)
        split, count = sets_of(problem).split(name), getattr(benchmark_of(problem).quick, name)
        known = reference.load(problem, name).parameters if name == "validation" else split.parameters(problem, count)
        began, path = time.perf_counter(), self.data / "reproduce" / problem.id / f"{name}.zarr"
        database = ocp_envs.generate(
            problem, path, known[:count], workers=self.workers, seed=split.seed, settings=split.settings
        )
        cli.say(f"{problem.id}: {len(database)} {name} instances, {time.perf_counter() - began:.0f} s")
        return database

    def _run(self, script: str, *arguments: str) -> None:
        options = ["--env", self.problem.id, "--data", str(self.data), "--results", str(self.results)]
        options += [] if self.workers is None else ["--workers", str(self.workers)]
        command = [sys.executable, str(cli.ROOT / "scripts" / script), *options, *arguments]
        cli.say(" ".join(command[1:]))
        subprocess.run(command, check=True)

    @cached_property
    def comparison(self) -> Comparison:
        """The comparison with reinforcement learning; in the quick form from the first initial conditions alone."""
        path = self.results / f"compare_{self.problem.id}.json"
        if self.quick or not path.exists():
            self._run("compare_rl_vs_moe.py", *(("--cases", str(COMPARED)) if self.quick else ()))
        return read(path, Comparison)

    @property
    def overview(self) -> Sources:
        """What the overview is made from; in the quick form from the comparison alone."""
        if self.quick:
            return Sources(self.comparison)
        path = self.results / f"compare_splits_{self.problem.id}.json"
        splits, cases = read(path, SplitComparison) if path.exists() else None, self.comparison.cases
        learners = learner_trainings(self.results, self.problem)
        checked = checked_row(self.results / f"planners_checked_{self.problem.id}.json", cases)
        found = None if splits is None else uniform_row(splits, FOUND, cases)
        seeds = None if splits is None else present(splits.seeds)
        others = [row for row in (checked, found) if row is not None]
        return Sources(self.comparison, self.trained.rows, learners, seeds or (), others)

    @cached_property
    def trained(self) -> TrainingComparison:
        """The record of the full form, for which everything is made that is missing."""
        path = self.results / f"compare_training_{self.problem.id}.json"
        if not path.exists():  # remove it to have it made again
            self._run("generate_data.py")
            self._run("compare_training.py")
        return read(path, TrainingComparison)

    @cached_property
    def material(self) -> gallery.Material:
        """What figures are drawn from."""
        if not self.quick:
            _ = self.trained
        training, validation = self._database("training"), self._database("validation")
        few = None if self.quick else training.first(benchmark_of(self.problem).training.instances)
        mixtures = [name for name in self.shipped if name.startswith("moe-kmeans-") and "pca" not in name]
        partitions = tuple(int(name.rsplit("-", 1)[1]) for name in mixtures)
        return gallery.Material(training.samples(few), validation.samples(), self.shipped, partitions)

    @cached_property
    def shipped(self) -> dict[str, NetworkPlanner]:
        """The networks of the benchmark that are shipped."""
        known = set(moe_policy.available(self.problem.id))
        names = [name for name in benchmark_of(self.problem).planners.trained if name in known]
        return {name: moe_policy.load(self.problem, name, kind=NetworkPlanner) for name in names}

    @property
    def cases(self) -> int:
        """Number of validation instances."""
        return len(self.material.validation) if self.quick else len(reference.load(self.problem, "validation"))

    @cached_property
    def rows(self) -> tuple[TrainingRow, ...]:
        """A row for each trained network."""
        published = benchmark_of(self.problem).published
        if self.quick:
            validation = self.material.validation
            models = {name: Model.of(planner, validation) for name, planner in self.shipped.items()}
            return tuple(TrainingRow.of(name, [model], published.get(name)) for name, model in models.items())
        rows = [row.with_paper(published.get(row.name)) for row in self.trained.rows]
        trainings = {name: Training.of(planner) for name, planner in self.shipped.items()}  # of the first seed
        return tuple(row.with_training(trainings[row.name]) if row.name in trainings else row for row in rows)


Table = Callable[[dict[str, Made], bool], tuple[Record, str]]


def overview_table(made: dict[str, Made], quick: bool) -> tuple[Record, str]:
    """The overview as a record and as text."""
    found = [overview_rows(made[problem.id].overview, benchmark_of(problem).overview) for problem in PAPER]
    table = OverviewTable(quick=quick, rows=tuple(row for rows in found for row in rows), provenance=provenance())
    return table, markdown_table(table.rows, OVERVIEW_COLUMNS)


def training_table(made: dict[str, Made], quick: bool) -> tuple[Record, str]:
    """The table of ways to train as a record and as text."""
    table = TrainingTable(quick=quick, rows=made[TRAINED].rows, provenance=provenance())
    return table, markdown_table(table.rows, TRAINING_COLUMNS)


def summary_table(made: dict[str, Made], quick: bool) -> tuple[Record, str]:
    """The summary as a record and as text."""
    wanted = [made[problem.id] for problem in PAPER if summarised(problem)]
    columns, rows = summary([Source(one.problem, one.rows, one.cases) for one in wanted])
    table = SummaryTable(quick=quick, columns=columns, rows=rows, provenance=provenance())
    return table, markdown_table(rows, summary_columns(columns))


TABLES: dict[str, Table] = {"overview": overview_table, "training": training_table, "summary": summary_table}


def draw(name: str, made: dict[str, Made], path: Path, quick: bool) -> Figure:
    """Draw the figure ``name`` at ``path``, as PNG and PDF."""
    if name == SKETCH:
        mixture_figure(path)
        return Figure(quick=quick, provenance=provenance())
    problem, kind = figure_names()[name]
    material = made[problem.id].material
    details = gallery.drawings(problem)[kind].draw(material, path)
    return Figure(
        quick=quick,
        details=ABSENT if details is None else details.to_json(),
        env_id=problem.id,
        training=len(material.training),
        validation=len(material.validation),
        models={model: planner.details["seed"] for model, planner in material.planners.items()},
        provenance=provenance(),
    )


def parse_arguments() -> argparse.Namespace:
    parser, figures = cli.parser(__doc__, env=None, data=True, workers=True), [SKETCH, *figure_names()]
    parser.add_argument("--all", action="store_true", help="all tables and figures")
    parser.add_argument("--table", nargs="+", choices=TABLES, default=[], metavar="NAME", help=", ".join(TABLES))
    parser.add_argument("--figure", nargs="+", choices=figures, default=[], metavar="NAME", help=", ".join(figures))
    parser.add_argument("--list", action="store_true", help="print the names of tables and figures, and make none")
    parser.add_argument("--quick", action="store_true", help="in minutes, from shipped networks")
    arguments = parser.parse()
    if arguments.all:
        arguments.table, arguments.figure = list(TABLES), figures
    if not (arguments.table or arguments.figure or arguments.list):
        parser.error("nothing to do: name a --table or a --figure, or ask for --all or --list")
    return arguments


def print_names() -> None:
    for name in TABLES:
        cli.say(f"table   {name}")
    cli.say(f"figure  {SKETCH}: gate and experts (figure 2)")
    for name, (problem, kind) in figure_names().items():
        drawing = gallery.drawings(problem)[kind]
        cli.say(f"figure  {name}: {drawing.shows}" + (f" (figure {drawing.paper})" if drawing.paper else ""))


def main() -> None:
    arguments = parse_arguments()
    if arguments.list:
        print_names()
        return
    cli.threads()
    began, quick = time.perf_counter(), arguments.quick
    results = arguments.results / "quick" if quick else arguments.results
    made = {problem.id: Made(problem, quick, arguments.data, results, arguments.workers) for problem in PAPER}
    for name in arguments.table:
        record, text = TABLES[name](made, quick)
        write(results / f"table_{name}.json", record)
        (results / f"table_{name}.md").write_text(text, encoding="utf-8")
        cli.say(f"\n{text}")
    for name in arguments.figure:
        path = results / f"figure_{name}"
        write(path.with_suffix(".json"), draw(name, made, path, quick))
        cli.say(f"{path}.png and .pdf, {time.perf_counter() - began:.0f} s")
    cli.say(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    cli.run(main, continues=True)
