"""What planners and reinforcement learners reach for what they spend: environment steps and wall time.

Learners: the trainings in ``training_<algorithm>_<env>[_seed<n>].json``, all seeds that are there. Planners: the
successes in ``compare_training_<env>.json`` and the solves and times in ``generation_<env>.json``. Training curves are
evaluated on the development set; so the shipped models and the optimal trajectories are rolled out from it, too, which
takes a minute or two. The record says what each side is given, and how its budget is counted. Writes
``budgets_<env>.json`` and ``.png``.

    python scripts/compare_budgets.py --env GroundVehicle-v0
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from moe_policy import store
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.budgets import BUDGET_COLUMNS, GIVEN, Budgets, Level, ShippedPlanner
from moe_policy.experiments.figures.budgets import budgets_figure
from moe_policy.experiments.learner_budgets import ChosenActor, DevelopmentMetrics, LearnerBudget
from moe_policy.experiments.learners import CaseSet, LearnerTraining, learner_trainings
from moe_policy.experiments.methods import solve_all
from moe_policy.experiments.planner_budgets import GenerationEffort, PlannerBudget, planner_rows
from moe_policy.experiments.seeds import TrainingComparison, TrainingRow
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.reports.records import read
from moe_policy.reports.tables import text_table
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.reference import ReferenceSet
from ocp_envs.support.provenance import provenance

#: Control period, seconds.
DT = 0.02


@dataclass(frozen=True)
class Sources:
    """The records that are read."""

    trainings: dict[str, list[LearnerTraining]]  # of learners, by name in the order of the comparison
    trained: list[TrainingRow]  # planners on the validation set
    effort: GenerationEffort | None  # for the training set; ``None`` where it is not known

    @classmethod
    def read(cls, folder: Path, problem: OptimalControlProblem) -> Sources:
        """The records of ``problem`` in ``folder``."""
        found, path = learner_trainings(folder, problem), folder / f"compare_training_{problem.id}.json"
        planners = read(path, TrainingComparison) if path.exists() else None
        order = dict.fromkeys((*benchmark_of(problem).learners.settings, *found))
        return cls(
            trainings={name: found[name] for name in order if name in found},
            trained=[] if planners is None else [*planners.sizes, *planners.rows],
            effort=GenerationEffort.read(folder, problem),
        )


def on_development(problem: OptimalControlProblem, method: Method, cases: ReferenceSet) -> DevelopmentMetrics:
    """The metrics of ``method`` from ``cases``; the return of a planner is charged as that of a learner is."""
    envs, policy = environments(problem, len(cases), DT), method.policy(problem, DT)
    episodes, charged = rollout(envs, policy, cases.parameters), None
    if method.planner is not None:
        charged = rollout(envs, policy, cases.parameters, evaluation="goal")
    envs.close()
    return DevelopmentMetrics.of(problem, episodes, cases.cost, charged)


def chosen_actor(
    problem: OptimalControlProblem, name: str, training: LearnerTraining, cases: ReferenceSet
) -> ChosenActor | None:
    """The shipped actor of the learner ``name`` on ``cases``, and when in its ``training`` it was chosen."""
    if name not in store.available(problem):
        return None
    policy = store.load(problem, name, kind=LearnedPolicy)
    seconds = {point.steps: point.seconds for point in training.run.curve}
    steps = cast(int, policy.details["steps"])
    development = on_development(problem, Method(name, policy), cases)
    return ChosenActor(steps=steps, seconds=seconds.get(steps), development=development)


def shipped_planners(
    problem: OptimalControlProblem, effort: GenerationEffort | None, cases: ReferenceSet
) -> tuple[ShippedPlanner, ...]:
    """The shipped networks of the benchmark on ``cases``, with what their data (``effort``) and training took."""
    rows = []
    for name in benchmark_of(problem).planners.compared:
        if name in store.available(problem):
            planner = store.load(problem, name, kind=NetworkPlanner)
            samples, seconds = planner.details["samples"], [planner.details["training"]["seconds"]]
            budget = None if effort is None else PlannerBudget.of(problem, effort, samples, seconds)
            development = on_development(problem, Method(name, planner), cases)
            rows.append(ShippedPlanner(name=name, samples=samples, budget=budget, development=development))
    return tuple(rows)


def tracked_optimum(problem: OptimalControlProblem, cases: ReferenceSet, data: Path) -> Level:
    """The optimal trajectories, tracked, from those of ``cases`` that are solved; they are kept in ``data``."""
    trajectories, costs = solve_all(problem, cases.parameters, keep=data / "optimal" / problem.id)
    known = cases[np.isfinite(costs)]
    method = Method("optimal", StoredPlans(cases.parameters, trajectories))
    return Level(name="optimal, tracked", cases=len(known), development=on_development(problem, method, known))


def compare(problem: OptimalControlProblem, sources: Sources, count: int | None, data: Path) -> Budgets:
    """The record of ``problem``, with planners evaluated from the first ``count`` development parameters, or all.

    Solutions are kept in the folder ``data``.
    """
    development, validation = (reference.load(problem, name) for name in ("development", "validation"))
    cli.at_most(count, len(development), "development parameters")
    cases, benchmark = development[:count], benchmark_of(problem)
    learners = {
        name: LearnerBudget.of(trainings, chosen_actor(problem, name, trainings[0], cases))
        for name, trainings in sources.trainings.items()
    }
    compared = benchmark.planners.compared
    return Budgets(
        env_id=problem.id,
        given=GIVEN,
        not_attempted=dict(benchmark.learners.unattempted),
        development=CaseSet(name="development", count=len(development), planners=len(cases)),
        validation=CaseSet(name="validation", count=len(validation)),
        learners=learners,
        generation=sources.effort,
        planners=planner_rows(problem, sources.trained, sources.effort, compared, len(validation)),
        shipped=shipped_planners(problem, sources.effort, cases),
        levels=(tracked_optimum(problem, cases, data),),
        provenance=provenance(),
    ).with_rows()


def main() -> None:
    parser = cli.parser(__doc__, data=True, cases="development parameters from which planners run")
    parser.add_argument("--records", metavar="FOLDER", type=Path, default=cli.RECORDS, help="records that are read")
    arguments = parser.parse()
    cli.threads()
    sources = Sources.read(arguments.records, arguments.problem)
    record = compare(arguments.problem, sources, arguments.cases, arguments.data)
    budgets_figure(cli.publish(arguments, f"budgets_{record.env_id}", record).with_suffix(".png"), record)
    cli.say(text_table(record.relative().rows, BUDGET_COLUMNS))
    for what, why in record.not_attempted.items():
        cli.say(f"not attempted: {what}: {why}")


if __name__ == "__main__":
    cli.run(main, continues=True)
