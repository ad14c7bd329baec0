"""The methods that are compared: the shipped planners and policies of a problem, and its optimal trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

from moe_policy import store
from moe_policy.control.stabiliser import Stabiliser
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.learners import LearnerTraining, training_file
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts
from moe_policy.planners.solver import BatchSolver, SolverPlanner
from moe_policy.planners.symmetric import Symmetrised
from moe_policy.protocols import Planner
from moe_policy.reports.records import read
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.score import optimum
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory


def solutions(count: int) -> str:
    """What a planner learnt from in words: ``count`` solutions."""
    return f"{count:,} solutions"


def steps(count: int) -> str:
    """What a reinforcement learner learnt from in words: ``count`` control steps."""
    return f"{count:,} steps"


def shipped(problem: OptimalControlProblem, results: Path | None = None) -> list[Method]:
    """The shipped models that the problem's benchmark compares: nearest neighbour, networks, learners; or none.

    The folder ``results`` has the learners' training records with their steps and durations. Without a record the steps
    are those of the policy and the duration is unknown.
    """
    benchmark, known = benchmark_of(problem), store.available(problem)
    methods = []
    if (nearest := store.shipped_nearest(problem)) is not None:
        methods.append(Method("nearest", nearest, solutions(len(nearest.parameters))))
    methods += chosen(problem, [name for name in benchmark.planners.compared if name in known])
    for name in benchmark.learners.settings:
        if name in known:
            policy = store.load(problem, name, kind=LearnedPolicy)
            path = None if results is None else results / training_file(name, problem.id, 0)
            training = None if path is None or not path.exists() else read(path, LearnerTraining)
            count = cast(int, policy.details["steps"]) if training is None else training.run.steps
            methods.append(Method(name, policy, steps(count), None if training is None else training.run.seconds))
    return methods


def chosen(problem: OptimalControlProblem, names: Sequence[str]) -> list[Method]:
    """The shipped networks of ``problem`` called ``names``."""
    methods = []
    for name in names:
        planner = store.load(problem, name, kind=NetworkPlanner)
        record = planner.details
        methods.append(Method(name, planner, solutions(record["samples"]), record["training"]["seconds"]))
    return methods


def named(problem: OptimalControlProblem, names: Sequence[str], results: Path | None = None) -> list[Method]:
    """The methods of ``problem`` called ``names``: those that are compared, and other shipped networks.

    ``results`` is as in :func:`shipped`.
    """
    compared = {method.name: method for method in (*shipped(problem, results), *stabiliser(problem))}
    return [compared[name] if name in compared else chosen(problem, [name])[0] for name in names]


def variants(problem: OptimalControlProblem, methods: Sequence[Method]) -> list[Method]:
    """The networks among ``methods`` averaged over the symmetry, then with the margin, where the problem has them."""
    networks = [(method, method.actor) for method in methods if isinstance(method.actor, NetworkPlanner)]
    careful: list[tuple[Method, Symmetrised | WithMargin]] = []
    if problem.symmetry is not None:
        careful += [(method, Symmetrised(problem, planner)) for method, planner in networks]
    if margin := benchmark_of(problem).planners.margin:
        careful += [
            (method, WithMargin(problem, planner, margin.parameter, margin.amount)) for method, planner in networks
        ]
    return [replace(method, name=planner.name, actor=planner) for method, planner in careful]


def stabiliser(problem: OptimalControlProblem) -> list[Method]:
    """Terminal regulation without a plan, where the goal of ``problem`` can be held; a list of one, or empty."""
    return [Method("stabiliser", Stabiliser(problem))] if problem.hold else []


def one_solve(problem: OptimalControlProblem, methods: Sequence[Method], solver: BatchSolver) -> list[Method]:
    """The networks among ``methods``, each with one solve of ``solver`` from its plan."""
    return [
        Method(f"{method.name}, one solve", SolverPlanner(problem, guessers=(method.actor,), solver=solver))
        for method in methods
        if isinstance(method.actor, NetworkPlanner)
    ]


def experts_of(methods: Sequence[Method]) -> tuple[Planner, ...]:
    """Every expert of the first mixture among ``methods``: guesses of every solution family; none without a mixture."""
    networks = [method.actor for method in methods if isinstance(method.actor, NetworkPlanner)]
    return next((n.expert_planners() for n in networks if isinstance(n.network, MixtureOfExperts)), ())


def solve_all(
    problem: OptimalControlProblem,
    p: Array,
    methods: Sequence[Method] | None = None,
    keep: Path | None = None,
    workers: int | None = None,
    reference: Array | None = None,
) -> tuple[Trajectory, Array]:
    """Best known trajectories from ``p`` (B, np) and their costs (B,), as :func:`moe_policy.score.optimum.solve_all`.

    The stored neighbours and the mixture are the first ones among ``methods``, by default those that are shipped.
    """
    methods = shipped(problem) if methods is None else methods
    nearest = next((method.actor for method in methods if isinstance(method.actor, NearestPlanner)), None)
    return optimum.solve_all(problem, p, nearest, experts_of(methods), keep, workers, reference)
