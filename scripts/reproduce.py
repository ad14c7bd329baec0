"""The paper's tables and figures, each by name, ours beside the paper's.

    python scripts/reproduce.py --all --quick
    python scripts/reproduce.py --table summary
    python scripts/reproduce.py --figure vehicle-histories quadcopter-obstacle-flip --quick

``--quick`` judges the shipped networks on the first validation problems, and draws from few training problems; both are
solved on the spot, under ``data/reproduce``. Without it everything is made from nothing by the scripts of the pipeline,
``generate_data.py`` and ``compare_training.py``, which takes hours, and goes on where it was interrupted. Tables go to
the terminal and to ``table_<name>.json`` and ``.md``, figures to ``figure_<name>.png``, ``.pdf`` and ``.json``: under
``results/quick`` and ``results``. ``--list`` names them all.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

import moe_policy
import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import TRAINING_COLUMNS, Comparison
from moe_policy.experiments.figures import gallery
from moe_policy.experiments.figures.phase import mixture_figure
from moe_policy.experiments.overview import OVERVIEW_COLUMNS, OverviewRow, overview_rows
from moe_policy.experiments.records import read
from moe_policy.experiments.summary import (
    beside_published,
    model_record,
    row_of,
    summarised,
    summary_columns,
    summary_record,
    training_record,
)
from moe_policy.experiments.tables import Column, markdown_table
from moe_policy.planners.network import NetworkPlanner
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: The paper's table of ways to train is about the pendulum.
TRAINED = PENDULUM.id
TABLES = ("overview", "training", "summary")
#: A sketch, the paper's second figure, belongs to no problem.
SKETCH = "mixture"
OVERVIEW_KEYS = tuple(column.of_part(OverviewRow.from_json) for column in OVERVIEW_COLUMNS)
#: Starts of the comparisons of the quick form.
COMPARED = 200


def log(text: str) -> None:
    print(text, flush=True)


def figure_names() -> dict[str, tuple[OptimalControlProblem, str]]:
    """Problem and drawing of every figure by its name."""
    return {
        f"{benchmark_of(problem).short}-{kind}": (problem, kind)
        for problem in BENCHMARK
        for kind in gallery.drawings(problem)
    }


@dataclass(frozen=True, eq=False)
class Source:
    """Where the tables and figures of one problem come from.

    Args:
        problem: the problem.
        quick: from few problems, and shipped networks.
        data: folder of the databases of all problems.
        results: folder of the results.
    """

    problem: OptimalControlProblem
    quick: bool
    data: Path
    results: Path

    def _database(self, name: str) -> ocp_envs.Database:
        problem = self.problem
        if not self.quick:
            return ocp_envs.Database.open(self.data / problem.id / f"{name}.zarr", problem)
        split, count = sets_of(problem).split(name), getattr(benchmark_of(problem).quick, name)
        p = (
            reference.load(problem, name).parameters[:count]
            if name == "validation"
            else split.parameters(problem, count)
        )
        began = time.perf_counter()
        path = self.data / "reproduce" / problem.id / f"{name}.zarr"
        database = ocp_envs.generate(problem, path, p, seed=split.seed, settings=split.settings)
        log(f"{problem.id}: {len(p)} {name} problems, {time.perf_counter() - began:.0f} s")
        return database

    def _run(self, script: str, *arguments: str) -> None:
        command = [sys.executable, str(ROOT / "scripts" / script), "--env", self.problem.id, *arguments]
        log(" ".join(command[1:]))
        subprocess.run([*command, "--results", str(self.results)], check=True)

    @cached_property
    def comparison(self) -> Comparison:
        """The comparison with reinforcement learning; in the quick form from the first initial conditions alone."""
        path = self.results / f"compare_{self.problem.id}.json"
        if self.quick or not path.exists():
            self._run("compare_rl_vs_moe.py", *(("--cases", str(COMPARED)) if self.quick else ()))
        return read(path, Comparison)

    @cached_property
    def record(self) -> Path:
        """The record of the full form, for which everything is made that is not there."""
        path = self.results / f"compare_training_{self.problem.id}.json"
        if not path.exists():  # remove it to have it made anew
            self._run("generate_data.py", "--data", str(self.data))
            self._run("compare_training.py", "--data", str(self.data))
        return path

    @cached_property
    def material(self) -> gallery.Material:
        """What figures are drawn from."""
        if not self.quick:
            _ = self.record
        training, validation = self._database("training"), self._database("validation")
        few = None if self.quick else training.first(benchmark_of(self.problem).training.instances)
        mixtures = [name for name in self.shipped if name.startswith("moe-kmeans-") and "pca" not in name]
        partitions = tuple(int(name.rsplit("-", 1)[1]) for name in mixtures)
        return gallery.Material(training.samples(few), validation.samples(), self.shipped, partitions)

    @cached_property
    def shipped(self) -> dict[str, NetworkPlanner]:
        """The networks of the benchmark that are shipped."""
        there = moe_policy.available(self.problem.id)
        return {
            name: moe_policy.load(self.problem.id, name)
            for name in benchmark_of(self.problem).planners.trained
            if name in there
        }

    @property
    def cases(self) -> int:
        """Number of validation problems."""
        return len(self.material.validation) if self.quick else len(reference.load(self.problem, "validation"))

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """A row for each trained network."""
        published, rows = benchmark_of(self.problem).published, []
        if not self.quick:
            for row in json.loads(self.record.read_text())["rows"]:
                if planner := self.shipped.get(row["name"]):  # the model of the first seed
                    row = {key: [value] for key, value in training_record(planner).items()} | row
                rows.append(beside_published(row, published[row["name"]]) if row["name"] in published else row)
            return rows
        for name, planner in self.shipped.items():
            rows.append(row_of(name, [model_record(planner, self.material.validation)], published.get(name)))
            log(f"{self.problem.id}: {name} evaluated")
        return rows


def table(name: str, sources: dict[str, Source]) -> tuple[dict[str, Any], tuple[Column, ...]]:
    """The record of the table ``name``, and its columns."""
    if name == "overview":
        found = [overview_rows(sources[p.id].comparison, benchmark_of(p).overview) for p in BENCHMARK]
        return {"rows": [row.to_json() for rows in found for row in rows]}, OVERVIEW_KEYS
    if name == "training":
        return {"rows": sources[TRAINED].rows}, TRAINING_COLUMNS
    wanted = [problem for problem in BENCHMARK if summarised(problem)]
    every = {problem.id: sources[problem.id].rows for problem in wanted}
    record = summary_record(wanted, every, {problem.id: sources[problem.id].cases for problem in wanted})
    return record, summary_columns(record)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    figures = [SKETCH, *figure_names()]
    parser.add_argument("--all", action="store_true", help="all tables and figures")
    parser.add_argument("--table", nargs="+", choices=TABLES, default=[], metavar="NAME", help=", ".join(TABLES))
    parser.add_argument("--figure", nargs="+", choices=figures, default=[], metavar="NAME", help=", ".join(figures))
    parser.add_argument("--list", action="store_true", help="name the tables and figures, and make none")
    parser.add_argument("--quick", action="store_true", help="in minutes, from shipped networks")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, help="folder of the results")
    arguments = parser.parse_args()
    if arguments.all:
        arguments.table, arguments.figure = list(TABLES), figures
    if not (arguments.table or arguments.figure or arguments.list):
        parser.error("nothing to do: name a --table or a --figure, or ask for --all or --list")
    return arguments


def main() -> None:
    arguments = parse_arguments()
    if arguments.list:
        log("\n".join([f"table   {name}" for name in TABLES] + [f"figure  {SKETCH}: gate and experts (figure 2)"]))
        for name, (problem, kind) in figure_names().items():
            drawing = gallery.drawings(problem)[kind]
            log(f"figure  {name}: {drawing.shows}" + (f" (figure {drawing.paper})" if drawing.paper else ""))
        return
    torch.set_num_threads(1)  # the networks are far too small for more
    began = time.perf_counter()
    target = arguments.results or ROOT / "results" / ("quick" if arguments.quick else "")
    sources = {problem.id: Source(problem, arguments.quick, arguments.data, target) for problem in BENCHMARK}
    form = {"quick": arguments.quick}
    for name in arguments.table:
        record, columns = table(name, sources)
        text = markdown_table(record["rows"], columns)
        write_json(target / f"table_{name}.json", form | record | {"provenance": provenance()})
        (target / f"table_{name}.md").write_text(text)
        log(f"\n{text}")
    for name in arguments.figure:
        path = target / f"figure_{name}"
        if name == SKETCH:
            mixture_figure(path)
            told: dict[str, Any] = {}
        else:
            problem, kind = figure_names()[name]
            material = sources[problem.id].material
            told = gallery.drawings(problem)[kind].draw(material, path) | {
                "env_id": problem.id,
                "training_problems": len(material.training),
                "validation_problems": len(material.validation),
                "models": {model: planner.details["seed"] for model, planner in material.planners.items()},
            }
        write_json(path.with_suffix(".json"), form | told | {"provenance": provenance()})
        log(f"{path}.png and .pdf, {time.perf_counter() - began:.0f} s")
    log(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
