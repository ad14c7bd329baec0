"""Compare optimal control, networks, mixtures of experts, reinforcement learning and the terminal regulator alone.

All methods run from the same initial conditions, through the same rollout loop. With no argument the shipped models of
the pendulum run on the shipped validation set, which takes about a minute; ``--env GroundVehicle-v0`` takes a few.
``--train`` makes everything from nothing, under ``data/compare/``: training, development and validation sets, planners,
and where the benchmark has short settings for it, a reinforcement learner. Prints the table, and writes it with all
metrics to ``compare_<env>.json`` and ``.png`` (with ``--train`` to ``compare_trained_<env>.json`` and ``.png``).
"""

import time
from pathlib import Path
from typing import cast

import numpy as np

import moe_policy
import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import (
    COLUMNS,
    Comparison,
    ComparisonRow,
    CostDifference,
    run,
    track_optimum,
)
from moe_policy.experiments.figures.comparison import comparison_figure
from moe_policy.experiments.methods import shipped, solutions, stabiliser, steps, variants
from moe_policy.learning import recipes
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.tables import text_table
from moe_policy.rl import training as baselines
from moe_policy.rollouts.episodes import Episodes
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance


def generated(problem: OptimalControlProblem, folder: Path, workers: int | None) -> dict[str, ocp_envs.Database]:
    """The databases of all splits by name, generated unless they are in ``folder``."""
    databases = {}
    for name in sets_of(problem).splits:
        split, began = sets_of(problem).split(name), time.perf_counter()
        p = split.parameters(problem)
        databases[name] = ocp_envs.generate(
            problem, folder / f"{name}.zarr", p, workers=workers, seed=split.seed, settings=split.settings
        )
        cli.say(f"{name} set: {len(p)} instances, {time.perf_counter() - began:.0f} s")
    return databases


def trained(
    problem: OptimalControlProblem,
    databases: dict[str, ocp_envs.Database],
    folder: Path,
    seed: int,
    workers: int | None,
) -> list[Method]:
    """The nearest neighbour, the compared networks and the short learners, trained now and saved in ``folder``."""
    benchmark, training = benchmark_of(problem), databases["training"]
    samples = training.samples(training.first(benchmark.training.instances))
    methods = [Method("nearest", NearestPlanner(samples), solutions(len(samples)))]
    for name in benchmark.planners.compared:
        with WorkerPool(workers) as pool:
            made = recipes.make(name, samples, settings=benchmark.training.settings, seed=seed, executor=pool)
        planner = cast(NetworkPlanner, made)
        planner.save(folder / name)
        seconds = planner.details["training"]["seconds"]
        cli.say(f"{name}: trained in {seconds:.0f} s")
        methods.append(Method(name, planner, solutions(len(samples)), seconds))
    for name, settings in benchmark.learners.short.items():
        result = baselines.train(problem, settings, databases["development"].parameters)
        result.policy.save(folder / name)
        cli.say(f"{name}: {settings.steps:,} steps in {result.curve[-1].seconds:.0f} s")
        methods.append(Method(name, result.policy, steps(settings.steps), result.curve[-1].seconds))
    return methods


def compare(
    problem: OptimalControlProblem,
    methods: list[Method],
    parameters: Array,
    costs: Array,
    data: Path,
    workers: int | None,
) -> tuple[CostDifference, list[ComparisonRow], dict[str, Episodes]]:
    """How far optimal costs are from the reference ``costs`` (B,), the rows of all methods, and their episodes by name.

    The optimum comes first, then ``methods``, their variants and the regulator.
    """
    optimum = track_optimum(problem, parameters, costs, methods, data / "optimal" / problem.id, workers)
    difference, solved = CostDifference.of(optimum.costs, costs), int(np.isfinite(optimum.costs).sum())
    cli.say(f"optimal trajectories: {solved} solved; {difference.within} at the reference cost within 0.1 %")
    rows, episodes = [optimum.row], {"optimal": optimum.episodes}
    others = [*methods, *variants(problem, methods), *stabiliser(problem)]
    for method in track(others, len(others), unit="method", label=problem.id, leave=False):
        row, episodes[method.name] = run(
            problem, method, parameters, optimal=optimum.trajectories, baseline=optimum.baseline
        )
        rows.append(row)
        cli.say(f"{method.name}: {row.metrics.success.count} of {len(parameters)}")
    return difference, rows, episodes


def main() -> None:
    parser = cli.parser(__doc__, data=True, workers=True, seed=0, cases="validation instances")
    parser.add_argument("--train", action="store_true", help="make data and models from nothing")
    arguments = parser.parse()
    cli.threads()
    began, problem = time.perf_counter(), arguments.problem
    if arguments.train:
        cli.at_most(arguments.cases, len(sets_of(problem).validation), "validation instances")
        if benchmark_of(problem).learners.short:
            cli.need("stable_baselines3")
        folder = arguments.data / "compare" / problem.id
        databases = generated(problem, folder, arguments.workers)
        methods = trained(problem, databases, folder, arguments.seed, arguments.workers)
        parameters, costs = databases["validation"].parameters, databases["validation"].costs().min(axis=1)
    else:
        validation = reference.load(problem, "validation")
        cli.at_most(arguments.cases, len(validation), "validation instances")
        if not (methods := shipped(problem, cli.RECORDS)):
            raise SystemExit(f"no models of {problem.id} are shipped; --train makes some")
        for name in set(benchmark_of(problem).learners.settings) - set(moe_policy.available(problem.id)):
            cli.say(f"{name} is not shipped for {problem.id}; scripts/train_rl.py trains it")
        parameters, costs = validation.parameters, validation.cost
    parameters, costs = parameters[: arguments.cases], costs[: arguments.cases]
    cli.say(f"{len(parameters)} initial conditions of {problem.id}")
    difference, rows, episodes = compare(problem, methods, parameters, costs, arguments.data, arguments.workers)
    record = Comparison(
        env_id=problem.id,
        cases=len(parameters),
        seed=arguments.seed,
        reference_difference=difference,
        seconds=time.perf_counter() - began,
        rows=tuple(rows),
        provenance=provenance(),
    )
    path = cli.publish(arguments, f"compare{'_trained' if arguments.train else ''}_{problem.id}", record)
    metrics = {row.name: row.metrics for row in rows}
    errors = {name: found.plan_end_error for name, found in episodes.items()}
    comparison_figure(path.with_suffix(".png"), metrics, errors, problem.goal.radius)
    cli.say(f"\n{text_table(rows, COLUMNS)}")
    cli.say(f"{record.seconds:.0f} s")


if __name__ == "__main__":
    cli.run(main, continues=True)
