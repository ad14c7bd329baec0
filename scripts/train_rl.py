"""Train a reinforcement learner with which the planners are compared.

The policy that is best on the development set is written to ``runs/models/<env>/<algorithm>.safetensors`` and
``.json``; settings, training curve and search to ``training_<algorithm>_<env>.json``. With ``--ship`` they go into the
package and into ``results/``. During training the best policy so far is in ``data/training``, so nothing is lost when a
run is stopped. Without other arguments this is the recorded run of the shipped pendulum policy.

    python scripts/train_rl.py --env PendulumSwingup-v0 --algorithm sac
    python scripts/train_rl.py --trial "discount 0.98" --set gamma=0.98 steps=60000

Other seeds (``--set seed=1``) are recorded as ``..._seed1.json``, and their policies are not kept. Neither are those of
a trial of the search for settings, complete or not: it is added to ``search_<algorithm>_<env>.json``, and the recorded
run repeats that list.
"""

import argparse
import ast
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from moe_policy import store
from moe_policy.experiments import cli, comparison
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.learners import (
    CaseSet,
    LearnerRun,
    LearnerTraining,
    LearnerValidation,
    Search,
    Trial,
    training_file,
)
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.reports.records import read, write
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.algorithms import ALGORITHMS
from moe_policy.rl.cloning import CloningSettings, clone
from moe_policy.rl.common import LearnerSettings, RLSettings
from moe_policy.rl.settings import ClonedPPOSettings
from moe_policy.rl.training import TrainingRun, train
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.progress import Progress
from ocp_envs.support.provenance import provenance


def override(problem: OptimalControlProblem, algorithm: str, texts: list[str]) -> LearnerSettings:
    """The settings of ``algorithm`` in the benchmark of ``problem``, changed by ``texts``, each ``name=value``."""
    settings = benchmark_of(problem).learners.settings.get(algorithm) or ALGORITHMS[algorithm]()
    names = {f.name for f in dataclasses.fields(settings)}
    values: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in names or not value:
            raise cli.UsageError(f"--set {text}: expected name=value with a name of {sorted(names)}")
        try:
            values[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            values[name] = value
    with cli.option("--set"):
        return dataclasses.replace(settings, **values)


def validated(problem: OptimalControlProblem, run: TrainingRun) -> LearnerValidation:
    """The best policy of ``run`` on the validation set."""
    parameters = reference.load(problem, "validation").parameters
    row, _ = comparison.run(problem, Method("learner", run.policy), parameters, batches=())
    metrics = row.metrics
    return LearnerValidation(reached=metrics.reached, success=metrics.success, left_box=metrics.left_box)


class Report:
    """Tells of a training on the terminal, keeps its best policy at ``kept``, and passes on its record so far."""

    def __init__(
        self, problem: OptimalControlProblem, settings: LearnerSettings, kept: Path, keep: Callable[[LearnerRun], None]
    ) -> None:
        self.development, self._began = reference.load(problem, "development"), provenance()
        self.cases = CaseSet(name="development", count=len(self.development))
        self._kept, self._keep, self._done = kept, keep, 0
        self.shown = Progress(settings.steps, unit="step", label=f"{settings.algorithm}, {problem.id}")

    def record(self, run: TrainingRun) -> LearnerRun:
        """The record of ``run``."""
        return LearnerRun.of(run, self.cases, self._began)

    def __call__(self, run: TrainingRun) -> None:
        """Report the last evaluation of ``run``."""
        last = run.curve[-1]
        self.shown.update(last.steps - self._done)
        self._done = last.steps
        ratio, violation = ("-" if value is None else f"{value:.3f}" for value in (last.cost_ratio, last.violation))
        cli.say(
            f"{last.steps:9d} steps {last.seconds:6.0f} s  success {last.success} cost / optimal {ratio} "
            f"violation {violation} return {last.mean_return:.1f} closest {last.closest:.3g}"
        )
        run.policy.save(self._kept)
        self._keep(self.record(run))


def trained(problem: OptimalControlProblem, settings: LearnerSettings, report: Report, models: Path) -> TrainingRun:
    """Train with progress on the terminal; a learner that begins with a cloned policy finds it in ``models``."""
    development = report.development
    common: dict[str, Any] = {
        "optimal_costs": development.cost,
        "details": {"development": report.cases.to_json()},
    }
    with report.shown:
        if isinstance(settings, CloningSettings):
            stored = store.load(problem, "nearest", kind=NearestPlanner)
            run = clone(problem, settings, stored, development.parameters, **common)
            report(run)
            return run
        if isinstance(settings, ClonedPPOSettings):
            begin = store.load_file(models / problem.id / CloningSettings.algorithm, problem)
            if not isinstance(begin, LearnedPolicy):
                raise cli.UsageError(f"{models / problem.id}: expected the policy of behaviour cloning, got {begin!r}")
            common["begin"] = begin
        return train(problem, cast(RLSettings, settings), development.parameters, on_evaluation=report, **common)


def parse_arguments() -> argparse.Namespace:
    parser = cli.parser(
        __doc__, data=True, models=True, ship="write the policy into the package and the record into results/"
    )
    parser.add_argument("--algorithm", choices=sorted(ALGORITHMS), default="sac", help="the learner; default sac")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings that are changed")
    parser.add_argument("--trial", metavar="NOTE", help="a trial of the search: what is tried; no policy is kept")
    return parser.parse()


def main() -> None:
    arguments = parse_arguments()
    cli.threads()
    problem, algorithm = arguments.problem, arguments.algorithm
    if algorithm != CloningSettings.algorithm:
        cli.need("sb3_contrib" if algorithm == "tqc" else "stable_baselines3")
    settings = override(problem, algorithm, arguments.set)
    path = arguments.results / f"search_{algorithm}_{problem.id}.json"
    earlier = read(path, Search).trials if path.exists() else ()

    def keep_trial(run: LearnerRun) -> None:
        if arguments.trial:
            trial = Trial(note=arguments.trial, run=run)
            write(path, Search(env_id=problem.id, trials=(*earlier, trial)))

    report = Report(problem, settings, arguments.data / "training" / f"{algorithm}_{problem.id}", keep_trial)
    run = trained(problem, settings, report, arguments.models)
    record = report.record(run)
    if not arguments.trial:
        found = LearnerTraining(env_id=problem.id, run=record, validation=validated(problem, run), search=earlier)
        if settings.seed == 0:
            run.policy.save(arguments.models / problem.id / algorithm)
        write(arguments.results / training_file(algorithm, problem.id, settings.seed), found)
    best = run.best
    cli.say(f"best after {best.steps} steps: success {best.success} of {record.development.count}, cost {best.cost}")


if __name__ == "__main__":
    cli.run(main)
