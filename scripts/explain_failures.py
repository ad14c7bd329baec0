"""List every validation case that a mixture of experts fails, with its cause: gate, expert, tracker or data.

What the causes mean stands in ``moe_policy/diagnosis.py``. Needs the databases of ``scripts/generate_data.py``: the
training set the mixture learnt from, and the validation set. Writes ``results/failures_<env>_<planner>.json`` (with
``_plan-end`` at its end for plans that are judged there, before any hold).

    python scripts/explain_failures.py --env GroundVehicle-v0 --planner moe-custom
    python scripts/explain_failures.py --env GroundVehicle-v0 --planner ./models/mine.safetensors
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

import torch

import ocp_envs
from moe_policy.experiments.diagnosis import Failure, Judgement, counts, explain
from moe_policy.experiments.tables import keyed, proportion, text_table
from moe_policy.rollouts.intervals import Proportion
from moe_policy.store import SHIPPED, load_file
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
WORDS = {Judgement.JUDGING_TIME: "judging time", Judgement.PLAN_END: "end of the plan"}


def shorter(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


COLUMNS = (
    keyed("index", "case"),
    keyed("parameters", "p", shorter),
    keyed("cause", "cause"),
    keyed("mode", "optimal mode"),
    keyed("right", "right", lambda experts: ", ".join(map(str, experts)) or "none"),
    keyed("chosen", "chosen"),
    keyed("confidence", "… with", ".2f"),
    keyed("successful", "would succeed", lambda experts: ", ".join(map(str, experts)) or "none"),
    keyed("relative_gap", "gap to 2nd mode", ".2g"),
    keyed("nearest_distance", "nearest sample", ".2g"),
    keyed("final_error", "error", ".2g"),
    keyed("predicted_error", "predicted", ".2g"),
)


def path_of(planner: str, env_id: str, models: Path) -> Path:
    """Where ``planner`` lies: a path with a folder in it, or the name of a model in ``models``."""
    path = Path(planner) if os.path.dirname(planner) else models / env_id / planner
    # Not with_suffix: names such as "moe-retrained-softmax-0.1" contain a dot.
    return path.with_name(path.name.removesuffix(".json").removesuffix(".safetensors"))


def summary(failures: list[Failure], cases: int) -> list[dict[str, Any]]:
    """The table of causes."""
    rows: list[dict[str, Any]] = [{"cause": cause, "failures": n} for cause, n in counts(failures).items()]
    return [*rows, {"cause": "all", "failures": len(failures), "of": cases}]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--planner", default="moe-custom", help="name of a mixture, or a path such as ./mine.json")
    parser.add_argument("--models", type=Path, default=SHIPPED, help="folder in which names are looked up")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--at", type=Judgement, choices=list(Judgement), default=Judgement.JUDGING_TIME, help="when")
    parser.add_argument("--neighbours", type=int, default=3, help="training samples tried before data are blamed")
    parser.add_argument("--cases", type=int, help="validation cases; all by default")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    path = path_of(arguments.planner, problem.id, arguments.models)
    planner = load_file(path, problem)
    databases = {
        name: ocp_envs.Database.open(arguments.data / problem.id / f"{name}.zarr", problem)
        for name in ("training", "validation")
    }
    cases = databases["validation"].samples()[: arguments.cases]
    training = databases["training"].samples()
    failures = explain(problem, planner, cases, training, at=arguments.at, neighbours=arguments.neighbours)

    records = [failure.record() for failure in failures]
    if records:
        print(text_table(records, COLUMNS))
    print(text_table(summary(failures, len(cases)), (keyed("cause", "cause"), keyed("failures", "failures"))))
    success = Proportion(len(cases) - len(failures), len(cases))
    print(f"{planner.name}: {proportion(success)} of {success.total} cases succeed at the {WORDS[arguments.at]}")
    suffix = "" if arguments.at is Judgement.JUDGING_TIME else f"_{arguments.at}"
    output = arguments.results / f"failures_{problem.id}_{path.name}{suffix}.json"
    record = {
        "env_id": problem.id,
        "planner": path.name,
        "seed": planner.details.get("seed"),
        "samples": planner.details.get("samples"),
        "clusters": planner.details.get("clusters"),
        "judged_at": str(arguments.at),
        "neighbours": arguments.neighbours,
        "keys": {name: database.key for name, database in databases.items()},
        "cases": len(cases),
        "unsolved": databases["validation"].totals()["problems"] - databases["validation"].totals()["solved"],
        "success": success.to_json(),
        "causes": counts(failures),
        "failures": records,
        "seconds": time.perf_counter() - began,
        "provenance": provenance(),
    }
    write_json(output, record)
    print(f"{record['seconds']:.0f} s; written to {output}")


if __name__ == "__main__":
    main()
