"""Train the reinforcement learner that the planners are compared with, and ship its policy.

With no argument this is the recorded run of the shipped pendulum policy. When it has ended, the policy that was best on
the development set is written to ``moe_policy/models/<env-id>/<algorithm>.safetensors`` and ``.json``, and settings,
training curve and search to ``results/training_<algorithm>_<env-id>.json``. Until then the best policy so far is in
``data/training``, so that nothing is lost when a run is stopped.

    python scripts/train_rl.py
    python scripts/train_rl.py --trial "discount 0.98" --set gamma=0.98 steps=60000

Other seeds (``--set seed=1``) are recorded as ``..._seed1.json`` and not shipped. A trial of the search for settings
ships nothing: it is added to ``results/search_<algorithm>_<env-id>.json``, whether stopped or not, and the recorded run
repeats that list next to its curve.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import json
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

import ocp_envs
from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.methods import Method
from moe_policy.rl.settings import ALGORITHMS, RLSettings
from moe_policy.rl.training import TrainingRun, train
from moe_policy.store import SHIPPED
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance, write_json

RESULTS = Path(__file__).resolve().parents[1] / "results"


def override(problem: OptimalControlProblem, algorithm: str, texts: list[str]) -> RLSettings:
    """The settings of ``algorithm`` in the problem's benchmark with ``name=value`` replaced."""
    settings = benchmark_of(problem).learners.settings.get(algorithm) or ALGORITHMS[algorithm]()
    names = {f.name for f in dataclasses.fields(settings)}
    values: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in names or not value:
            raise SystemExit(f"--set {text}: expected name=value with a name of {sorted(names)}")
        try:
            values[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            values[name] = value
    return dataclasses.replace(settings, **values)


def read_search(path: Path) -> list[dict[str, Any]]:
    return json.loads(path.read_text())["trials"] if path.exists() else []


def judge(problem: OptimalControlProblem, run: TrainingRun) -> dict[str, Any]:
    """The chosen policy on the validation set."""
    parameters = reference.load(problem, "validation").parameters
    row, _ = comparison.run(problem, Method("learner", run.policy), parameters, batches=())
    metrics = row.metrics
    validation = {"reached": metrics.reached.to_json(), "success": metrics.success.to_json()}
    return validation | {"left_box": metrics.left_box}


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env_id", nargs="?", default="PendulumSwingup-v0")
    parser.add_argument("--algorithm", choices=sorted(ALGORITHMS), default="sac")
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings that differ from the defaults"
    )
    parser.add_argument("--trial", metavar="NOTE", help="a trial of the search: what is tried; nothing is shipped")
    parser.add_argument("--models", type=Path, default=SHIPPED, help="folder of the shipped models")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument(
        "--checkpoints", type=Path, default=Path("data/training"), help="folder of the best policy so far"
    )
    return parser.parse_args()


def main() -> None:
    arguments = parse_arguments()
    torch.set_num_threads(1)  # the networks are far too small for more
    problem = ocp_envs.load(arguments.env_id)
    settings = override(problem, arguments.algorithm, arguments.set)
    name = f"{arguments.algorithm}_{problem.id}"
    development = reference.load(problem, "development")
    judged_on = {"set": "development", "count": len(development)}
    search_path = arguments.results / f"search_{name}.json"
    started = provenance()
    earlier = read_search(search_path)
    bar = tqdm(total=settings.steps, unit="step", desc=name, mininterval=5)

    def report(run: TrainingRun) -> None:
        last = run.curve[-1]
        bar.update(last.steps - bar.n)
        cost = "-" if last.cost is None else f"{last.cost:.3f}"
        bar.write(
            f"{last.steps:9d} steps {last.seconds:6.0f} s  success {last.success} cost {cost} "
            f"score {last.score:.3f} return {last.mean_return:.1f} final error {last.final_error:.3g}"
        )
        run.policy.save(arguments.checkpoints / name)
        if arguments.trial:
            trial = {"note": arguments.trial, **record_of(run)}
            write_json(search_path, {"env_id": problem.id, "trials": [*earlier, trial]})

    def record_of(run: TrainingRun) -> dict[str, Any]:
        complete = run.curve[-1].steps >= settings.steps
        return {**run.record(), "complete": complete, "development": judged_on, "provenance": started}

    run = train(
        problem,
        settings,
        development.parameters,
        optimal_costs=development.cost,
        on_evaluation=report,
        details={"development": judged_on},
    )
    bar.close()
    if not arguments.trial:
        record = {"env_id": problem.id, **record_of(run), "validation": judge(problem, run), "search": earlier}
        if settings.seed == 0:
            run.policy.save(arguments.models / problem.id / arguments.algorithm)
        suffix = f"_seed{settings.seed}" if settings.seed else ""
        write_json(arguments.results / f"training_{name}{suffix}.json", record)
    best = run.best
    print(f"best after {best.steps} steps: success {best.success} of {len(development)}, mean cost {best.cost}")


if __name__ == "__main__":
    main()
