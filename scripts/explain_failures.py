"""List every validation instance on which a mixture of experts fails, with its cause: gate, expert, tracker or data.

``moe_policy/experiments/diagnosis.py`` defines the causes. Needs two databases of ``scripts/generate_data.py``: the
training set of the mixture, and the validation set. Writes ``failures_<env>_<planner>.json`` (ending in ``_plan-end``
where plans are evaluated at their end, before any regulation).

    python scripts/explain_failures.py --env GroundVehicle-v0 --planner moe-custom
    python scripts/explain_failures.py --env GroundVehicle-v0 --planner ./models/mine.safetensors
"""

import argparse
import os
import time
from pathlib import Path

from moe_policy.experiments import cli
from moe_policy.experiments.diagnosis import explain
from moe_policy.experiments.failures import COLUMNS, Diagnosis, EvaluatedAt, counts
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts
from moe_policy.reports.tables import Column, proportion, text_table
from moe_policy.rollouts.intervals import Proportion
from moe_policy.store import SHIPPED, load_file
from ocp_envs.support.provenance import provenance

WHEN = {EvaluatedAt.EVALUATION_TIME: "evaluation time", EvaluatedAt.PLAN_END: "end of the plan"}


def path_of(planner: str, env_id: str, models: Path) -> Path:
    """Path of ``planner``: itself if it contains a folder, or that of the model of this name in ``models``."""
    path = Path(planner) if os.path.dirname(planner) else models / env_id / planner
    # Not with_suffix: names such as "moe-retrained-softmax-0.1" contain a dot.
    return path.with_name(path.name.removesuffix(".json").removesuffix(".safetensors"))


def parse() -> argparse.Namespace:
    parser = cli.parser(__doc__, data=True, cases="validation instances")
    parser.add_argument("--planner", default="moe-custom", help="name of a mixture, or a path such as ./mine.json")
    parser.add_argument("--models", type=Path, default=SHIPPED, help="folder in which names are looked up")
    parser.add_argument(
        "--at", type=EvaluatedAt, choices=list(EvaluatedAt), default=EvaluatedAt.EVALUATION_TIME, help="when"
    )
    parser.add_argument("--neighbours", type=cli.positive, default=3, help="training samples that are tracked")
    return parser.parse()


def main() -> None:
    arguments = parse()
    cli.threads()

    began, problem = time.perf_counter(), arguments.problem
    path = path_of(arguments.planner, problem.id, arguments.models)
    with cli.option("--planner"):
        planner = load_file(path, problem, kind=NetworkPlanner)
    if not isinstance(planner.network, MixtureOfExperts):
        raise cli.UsageError(f"--planner: {planner.name} is a single network, expected a mixture of experts")
    training, validation = (cli.database(arguments, name) for name in ("training", "validation"))
    cases, totals = validation.samples(), validation.totals()
    cli.at_most(arguments.cases, len(cases), "solved validation instances")
    cases = cases[: arguments.cases]
    failures = explain(problem, planner, cases, training.samples(), at=arguments.at, neighbours=arguments.neighbours)
    record = Diagnosis(
        env_id=problem.id,
        planner=path.name,
        seed=planner.details.get("seed"),
        samples=planner.details.get("samples"),
        clusters=planner.details.get("clusters"),
        judged_at=arguments.at,
        neighbours=arguments.neighbours,
        keys={"training": training.key, "validation": validation.key},
        cases=len(cases),
        unsolved=totals["problems"] - totals["solved"],
        success=Proportion(len(cases) - len(failures), len(cases)),
        causes=counts(failures),
        failures=tuple(failures),
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )
    report(record, planner.name)
    suffix = "" if arguments.at is EvaluatedAt.EVALUATION_TIME else f"_{arguments.at}"
    cli.publish(arguments, f"failures_{problem.id}_{path.name}{suffix}", record)
    cli.say(f"{record.seconds:.0f} s")


def report(record: Diagnosis, name: str) -> None:
    """Print the failures of the planner ``name``, their number by cause, and the fraction of successes."""
    if record.failures:
        cli.say(text_table(record.failures, COLUMNS))
    rows = [*record.causes.items(), ("all", len(record.failures))]
    cli.say(text_table(rows, (Column("cause", lambda row: row[0]), Column("failures", lambda row: row[1]))))
    success = record.success
    cli.say(f"{name}: {proportion(success)} of {success.total} cases succeed at the {WHEN[record.judged_at]}")


if __name__ == "__main__":
    cli.run(main)
