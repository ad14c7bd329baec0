"""The quadcopter under the other reading of its cost: do the conclusions change?

The paper prints the state weights for (position, velocity, angles, rates), while the program it describes orders states
as (position, angles, velocity, rates): the weights 1 of the velocity and 0.1 of the angles may be exchanged. Here the
problem with exchanged weights is generated, learnt and tracked as ``Quadcopter-v0``, from the same initial conditions
and with the same settings. Databases go to ``data/QuadcopterSwapped-v0/``, where an interrupted run continues. Writes
``sensitivity_Quadcopter-v0.json``.

    python scripts/check_sensitivity.py
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import ocp_envs
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, Sensitivity, run
from moe_policy.experiments.methods import solutions
from moe_policy.learning import recipes
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from ocp_envs.data.samples import Samples
from ocp_envs.problems.quadcopter import QUADCOPTER, cost_rate
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.pool import WorkerPool
from ocp_envs.support.provenance import provenance
from ocp_envs.system import Expression


def swapped_rate(
    state: Sequence[Expression], control: Sequence[Expression], context: SimpleNamespace, c: SimpleNamespace
) -> Expression:
    """The cost rate with the weights of velocity and angles exchanged."""
    return cost_rate([*state[:3], *state[6:9], *state[3:6], *state[9:]], control, context, c)


SWAPPED = dataclasses.replace(QUADCOPTER, id="QuadcopterSwapped-v0", cost_rate=swapped_rate)


def generated(name: str, data: Path, workers: int | None) -> Samples:
    """The solved instances of the split ``name`` of the changed problem, generated unless they are in ``data``."""
    split, path = sets_of(QUADCOPTER).split(name), data / SWAPPED.id / f"{name}.zarr"
    parameters, settings = split.parameters(QUADCOPTER), split.settings
    database = ocp_envs.generate(SWAPPED, path, parameters, seed=split.seed, settings=settings, workers=workers)
    cli.say(f"{name}: {database.totals()}")
    return database.samples()


def main() -> None:
    arguments = cli.parser(__doc__, env=None, data=True, workers=True).parse()
    cli.threads()
    ocp_envs.register(SWAPPED)
    benchmark, weights = benchmark_of(QUADCOPTER), TrackingWeights.default(QUADCOPTER)
    training, validation = (generated(name, arguments.data, arguments.workers) for name in ("training", "validation"))
    p, optimal = validation.parameters, validation.trajectory
    row, baseline = run(SWAPPED, Method("optimal", StoredPlans(p, optimal)), p, weights=weights, batches=())
    rows = [row]
    for name in benchmark.planners.compared:
        with WorkerPool(arguments.workers) as pool:
            made = recipes.make(name, training, settings=benchmark.training.settings, executor=pool)
        planner = cast(NetworkPlanner, made)
        method = Method(name, planner, solutions(len(training)), planner.details["training"]["seconds"])
        row, _ = run(SWAPPED, method, p, optimal=optimal, baseline=baseline, weights=weights, batches=())
        rows.append(row)
        cli.say(f"{name}: {row.metrics.success.count} of {len(p)}")
    record = Sensitivity(env_id=SWAPPED.id, cases=len(p), rows=tuple(rows), provenance=provenance())
    cli.publish(arguments, f"sensitivity_{QUADCOPTER.id}", record)
    print(text_table(rows, COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
