"""Planners for a problem of one's own, trained on a database and compared in one call.

Three sets of instances keep the comparison honest. Planners learn from the database. How many experts a mixture has is
chosen on development instances, and metrics are measured on test instances; both are drawn anew and solved or flown,
never learnt from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.learning.clustering import Labels, cluster, without_small
from moe_policy.learning.settings import DEFAULT, TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.repaired import Repaired
from moe_policy.planners.solver import SolverPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.protocols import Planner
from moe_policy.rollouts.compared import Comparison
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import TOLERANCES, evaluate
from moe_policy.rollouts.rollout import rollout
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.solver import lent_solvers
from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.progress import Progress

#: Numbers of clusters of k-means that are compared.
CLUSTERS = (2, 4, 8, 16)
#: Environments that are simulated at a time.
_BATCH = 500
#: Samples of the smallest cluster that an expert can learn from.
_LEAST = 10
#: Seeds of the development and of the test instances begin here, away from those that databases usually have.
_DEVELOPMENT, _TEST = 1_000_001, 2_000_001


@checked
def compare(
    problem: ProblemOrId,
    database: Samples | SampleSource,
    *,
    clusters: Sequence[int] | None = None,
    settings: TrainingSettings = DEFAULT,
    development: int = 200,
    test: int = 500,
    repaired: bool = True,
    seed: int = 0,
    progress: bool | None = None,
) -> Comparison:
    """Train a single network and mixtures of experts, track their plans, and compare them with the tracked optimum.

    Mixtures have one expert for each solution family where several occur, and one for each cluster of k-means; their
    number k is the smallest whose success on the development instances is not below the 95 % interval of the best.
    ``print`` shows the table. Training and rollouts run in this process.

    Args:
        problem: the problem.
        database: what planners learn from: a Database, its samples, or the result of :func:`ocp_envs.solve_many`.
        clusters: numbers k of clusters of k-means that are compared, by default 2, 4, 8 and 16. Those with a cluster
            too small to learn from are left out; small solution families are joined with others.
        settings: how networks are trained.
        development: number of instances on which the number of experts is chosen.
        test: number of instances on which planners are compared.
        repaired: compare also one solve from each plan of the single network and of the best mixture.
        seed: of the instances and of the trainings.
        progress: show it, as :func:`ocp_envs.generate` does.

    Raises:
        ValueError: numbers out of range, samples of another problem, or none; or a seed whose instances are among the
            samples.
    """
    problem, samples = problem_of(problem), samples_of(database)
    if samples.problem.id != problem.id:
        raise ValueError(f"the database belongs to {samples.problem.id}, not to {problem.id}")
    for name, count in {"development": development, "test": test}.items():
        check_whole(name, count, 1, 10**6)
    clusters = [k for k in CLUSTERS if k <= len(samples)] if clusters is None else clusters
    for k in clusters:
        check_whole("each of clusters", k, 2, len(samples))
    chosen_on = _fresh(problem, samples, _DEVELOPMENT + seed, development)
    tested_on = _fresh(problem, samples, _TEST + seed, test)
    trials: dict[str, Callable[[], Planner]] = {"snn": lambda: fit_single(samples, settings=settings, seed=seed)}
    trials |= {name: _mixture(samples, labels, settings, seed) for name, labels in _partitions(samples, clusters, seed)}
    bar = Progress(len(trials), unit="planner", label=f"{problem.id}, compare", shown=progress)
    trained: dict[str, Planner] = {}
    counts: dict[str, int] = {}
    with bar:
        for name, fit in trials.items():
            trained[name] = fit()
            counts[name] = _measure(problem, _fly(problem, trained[name], chosen_on))
            bar.update(latest=name)
    kept = _chosen(counts, development)
    best = max(kept, key=lambda name: (counts[name], -list(kept).index(name)))
    planners = _lined_up(problem, samples, {name: trained[name] for name in kept}, best, repaired, tested_on)
    flights = {name: _fly(problem, planner, tested_on) for name, planner in planners.items()}
    metrics = {name: evaluate(problem, episodes, flights["optimal"]) for name, episodes in flights.items()}
    return Comparison(problem, planners, metrics, counts, best, (len(samples), development, test))


def _fresh(problem: OptimalControlProblem, samples: Samples, seed: int, count: int) -> Array:
    """``count`` new instances, none of which is among the ``samples``."""
    drawn = sample(problem, seed, count)
    known = {row.tobytes() for row in np.ascontiguousarray(samples.parameters)}
    if any(row.tobytes() in known for row in np.ascontiguousarray(drawn)):
        raise ValueError(f"{problem.id}: instances of this seed are among the samples to learn from; give another seed")
    return drawn


def _partitions(samples: Samples, clusters: Sequence[int], seed: int) -> list[tuple[str, Labels]]:
    """Partitions of the ``samples`` by name: by solution families where several occur, and by k-means.

    Small clusters are joined with others; what then equals a partition into fewer clusters is left out.
    """
    found = [("moe-custom", cluster(samples, "custom"))] if len(np.unique(samples.mode)) > 1 else []
    found += [(f"moe-kmeans-{k}", cluster(samples, "kmeans", k=k, seed=seed)) for k in sorted(set(clusters))]
    joined = [(name, without_small(samples, labels, _LEAST), labels.k) for name, labels in found]
    return [(name, labels) for name, labels, k in joined if labels.k == k or (name == "moe-custom" and labels.k > 1)]


def _mixture(samples: Samples, labels: Labels, settings: TrainingSettings, seed: int) -> Callable[[], Planner]:
    return lambda: fit_mixture(samples, labels, settings=settings, seed=seed)


def _fly(problem: OptimalControlProblem, planner: Planner, p: Array) -> Episodes:
    envs = environments(problem, min(len(p), _BATCH))
    return rollout(envs, TrackingPolicy(problem, planner), p)


def _measure(problem: OptimalControlProblem, episodes: Episodes) -> int:
    """In how many episodes the plan ends at the goal, on a path that violates constraints by at most a tolerance."""
    good = episodes.plan_end_error < problem.goal.radius
    return int((good & episodes.clear(TOLERANCES[-1])).sum())


def fewest(counts: Mapping[int, float], cases: int) -> tuple[int, tuple[float, float]]:
    """The smallest k whose count is not below the 95 % interval of the largest of ``counts``, and that interval.

    Each counts some of the ``cases``.
    """
    low, high = Proportion(round(max(counts.values())), cases).interval
    return min(k for k, count in counts.items() if count >= low * cases), (low * cases, high * cases)


def _chosen(counts: Mapping[str, int], cases: int) -> list[str]:
    """The names of ``counts`` without the mixtures over other numbers of clusters than the one that is chosen."""
    by_k = {int(name.rpartition("-")[2]): count for name, count in counts.items() if "kmeans" in name}
    k = fewest(by_k, cases)[0] if by_k else None
    return [name for name in counts if "kmeans" not in name or name == f"moe-kmeans-{k}"]


def _lined_up(
    problem: OptimalControlProblem,
    samples: Samples,
    trained: Mapping[str, Planner],
    best: str,
    repaired: bool,
    p: Array,
) -> dict[str, Planner]:
    """All planners that are compared on the instances ``p``, by name."""
    with lent_solvers(problem).one() as solver:
        optima = SolverPlanner(problem, samples, solver=solver)(p)
    planners: dict[str, Planner] = {
        "optimal": StoredPlans(p, optima, problem),
        "nearest": NearestPlanner(samples),
        **trained,
    }
    for name in dict.fromkeys(["snn", best]) if repaired else ():
        planners[f"{name}, one solve"] = Repaired(trained[name], name=f"{name}, one solve")
    return planners
