"""Train the planners of an environment from its training database.

The planners go to ``runs/models/<env-id>/``, with ``--ship`` into the package. Run ``scripts/generate_data.py`` first.

    python scripts/train_planners.py
    python scripts/train_planners.py --names snn moe-custom --seed 1
    python scripts/train_planners.py --env GroundVehicle-v0 --names moe-auto --cases 36600
"""

import time

from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.learning import recipes
from ocp_envs.support.pool import WorkerPool


def main() -> None:
    parser = cli.parser(
        __doc__,
        data=True,
        models=True,
        workers=True,
        seed=0,
        cases="training instances, those that are solved first, with the epochs of so few",
        ship="put the planners into the package",
    )
    parser.add_argument(
        "--names",
        metavar="NAME",
        nargs="+",
        help="recipes, see moe_policy/learning/recipes.py; the benchmark's by default",
    )
    arguments = parser.parse()
    with cli.option("--names"):
        for name in arguments.names or ():
            recipes.check(name)
    cli.threads()
    problem, benchmark = arguments.problem, benchmark_of(arguments.problem)
    database = cli.database(arguments, "training")
    seed, training, few = arguments.seed, benchmark.training, arguments.cases
    samples = database.samples(database.first(few or training.instances))
    kept = arguments.data / problem.id / "training.continuation"
    with WorkerPool(arguments.workers) as pool:
        for name in arguments.names or ("nearest", *benchmark.planners.trained):
            began, settings = time.perf_counter(), training.settings_of(few, name)
            chosen = samples[: benchmark.planners.stored] if name == "nearest" else samples
            planner = recipes.make(name, chosen, settings=settings, seed=seed, executor=pool, kept=kept)
            planner.rounded().save(arguments.models / problem.id / name)
            cli.say(f"{name}: {len(chosen)} samples, {settings.epochs} epochs, {time.perf_counter() - began:.1f} s")


if __name__ == "__main__":
    cli.run(main)
