"""Compare mixtures that know the value gap between families with usual ones.

The families are those that continuation finds; each is continued across its border while its cost exceeds the best one
by at most 10 %. Mixtures are trained with several seeds and evaluated on the development set, and on other instances at
the discontinuity. Needs the database ``training``. Results are kept under
``data/compare_borders/``: an interrupted command continues where it stopped. Writes ``borders_<env>.json``.

    python scripts/compare_borders.py
    python scripts/compare_borders.py --env GroundVehicle-v0
"""

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.borders import BORDER_COLUMNS, VARIANTS, BorderModel, BorderRow, Borders, Mixtures
from moe_policy.experiments.comparison import run
from moe_policy.learning.clustering import Labels
from moe_policy.learning.families import NEIGHBOURS, families_of
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import read, write
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from ocp_envs.data.beyond import MARGIN, beyond
from ocp_envs.data.continuation import continued
from ocp_envs.data.database import Database
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.sets.hard_sets import NearEqualCosts
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.provenance import provenance

#: Seed of the instances at the discontinuity.
SEED = 808


def at_the_discontinuity(database: Database, trained: Ints, folder: Path, workers: int | None) -> Array:
    """Parameters (B, np) of instances whose second-best family costs little more than the best: those of ``database``
    that are not ``trained`` on, if there are enough, and else random ones, which are solved in ``folder``.
    """
    problem, declared = database.problem, sets_of(database.problem).boundary
    assert isinstance(declared, NearEqualCosts)
    others = database.samples()
    others = others[~np.isin(others.index, trained)]
    near = others[relative_cost_difference(others.mode_costs) < declared.limit][: declared.size]
    if len(near) == declared.size:
        return near.parameters
    drawn = dataclasses.replace(declared, seed=SEED, slack=declared.limit, spare=1.0)
    return drawn.candidates(problem, folder, workers).parameters


@dataclass(frozen=True, eq=False)
class Trial:
    """The trainings of ``mixtures``, evaluated on the sets of initial conditions ``cases``, (B, np) by name."""

    mixtures: Mixtures
    cases: dict[str, Array]
    kept: Path  # folder of results

    def models(self, seed: int) -> list[BorderModel]:
        """All mixtures of ``seed``."""
        paths = {name: self.kept / f"{name.replace(', ', '-').replace(' ', '-')}-s{seed}.json" for name in VARIANTS}
        if not all(path.exists() for path in paths.values()):
            for name, planner in self.mixtures.planners(seed).items():
                write(paths[name], self._evaluated(planner, seed))
        models = [read(path, BorderModel) for path in paths.values()]
        for model in models:
            cli.say(f"seed {seed}, {model.name}: {model.at_plan_end}")
        return models

    def _evaluated(self, planner: NetworkPlanner, seed: int) -> BorderModel:
        counts, method = {}, Method(planner.name, planner)
        for name, parameters in self.cases.items():
            found = run(planner.problem, method, parameters, batches=())[0].metrics.success_at_plan_end
            assert found is not None
            counts[name] = found.count
        error = planner.details["training"]["test_error"]
        return BorderModel(name=planner.name, seed=seed, at_plan_end=counts, test_error=error)


def main() -> None:
    parser = cli.parser(__doc__, data=True, workers=True)
    parser.add_argument("--seeds", metavar="N", type=cli.positive, default=3, help="training seeds of every mixture")
    arguments = parser.parse()
    cli.threads()
    problem = arguments.problem
    if not isinstance(sets_of(problem).boundary, NearEqualCosts):
        parser.error(f"{problem.id} has no instances at which two families cost the same")
    database = cli.database(arguments, "training")
    kept = arguments.data / "compare_borders" / problem.id
    training = benchmark_of(problem).training
    first, epochs = training.over_seeds or (training.instances, training.settings.epochs)
    samples, settings = database.samples(database.first(first)), dataclasses.replace(training.settings, epochs=epochs)
    near = at_the_discontinuity(database, samples.index, kept, arguments.workers)
    cases = {"uniform": sets_of(problem).development.parameters(problem), "boundary": near}
    folder = arguments.data / problem.id / "training.continuation"
    continuation = continued(samples, folder, neighbours=NEIGHBOURS, workers=arguments.workers)
    parts = families_of(samples, continuation)
    labels = Labels(parts.values, tuple(f"family {i}" for i in range(parts.values.max() + 1)), "continuation")
    began = time.perf_counter()
    found = beyond(samples, labels.families, pairs=continuation.pairs)
    seconds = time.perf_counter() - began
    cli.say(f"{len(found.rows)} trajectories beyond a border, of {found.solves} solves, {seconds:.0f} s")
    trial = Trial(Mixtures(samples, labels, found, settings), cases, kept)
    models = [trial.models(seed) for seed in range(arguments.seeds)]
    record = Borders(
        env_id=problem.id,
        cases={name: len(parameters) for name, parameters in cases.items()},
        samples=len(samples),
        families=tuple(labels.sizes.tolist()),
        margin=MARGIN,
        further=len(found.rows),
        two=int(((found.excess < float("inf")).sum(axis=1) > 1).sum()),
        solves=found.solves,
        seconds=seconds,
        rows=tuple(BorderRow.of(of_seeds) for of_seeds in zip(*models)),
        settings=dataclasses.asdict(settings),
        training_key=database.key,
        provenance=provenance(),
    )
    cli.publish(arguments, f"borders_{problem.id}", record)
    print(text_table(record.rows, BORDER_COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
