"""The methods that are compared: the shipped planners and policies of a problem, and its optimal trajectories.

A planner is tracked with LQR. A learned policy acts until it first enters the goal ball; then the goal is regulated.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from moe_policy import store
from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.learners import LearnerTraining, training_file
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts
from moe_policy.planners.solver import BatchSolver, SolverPlanner, lookaround_of
from moe_policy.planners.symmetric import Symmetrised
from moe_policy.protocols import Planner, Policy
from moe_policy.reports.records import read
from moe_policy.rl.actor import LearnedPolicy
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.archives import DamagedFileError, read_arrays, write_arrays
from ocp_envs.support.arrays import Array
from ocp_envs.support.progress import track
from ocp_envs.trajectory import Trajectory

#: Instances that one thread solves and keeps at a time.
SHARE = 250
#: Relative excess over the reference cost up to which a solution counts as the best known one.
SAME = 1e-3


@dataclass(frozen=True, eq=False)
class Method:
    """A planner or a policy under a name."""

    name: str  # in tables; one of the shipped names, such as ``"moe-custom"``
    actor: Planner | Policy  # a planner (called with p) or a policy (with ``predict``)
    data: str | None = None  # what it learnt from, in words; ``None`` where nothing was learnt
    seconds: float | None = None  # of the training without that of data; ``None`` where nothing was learnt

    @property
    def planner(self) -> Planner | None:
        """The actor if it plans."""
        return None if isinstance(self.actor, Policy) else self.actor

    def policy(self, problem: OptimalControlProblem, dt: float, weights: TrackingWeights | None = None) -> Policy:
        """The actor as a policy with control period ``dt``, seconds; ``weights`` are the problem's own by default."""
        if self.planner is not None:
            return TrackingPolicy(problem, self.planner, dt, weights)
        acting = cast(Policy, self.actor)
        if isinstance(acting, Stabiliser) or problem.hold == 0:
            return acting
        return Stabilised(acting, problem, dt, weights)


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


def optimal_planner(
    problem: OptimalControlProblem,
    nearest: NearestPlanner | None = None,
    guessers: Sequence[Planner] = (),
    solver: BatchSolver | None = None,
) -> SolverPlanner:
    """The solver as a planner, warm-started from ``nearest``, by default the shipped one if any, and ``guessers``."""
    nearest = store.shipped_nearest(problem) if nearest is None else nearest
    return SolverPlanner(problem, nearest, guessers=guessers, solver=solver)


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
    """Best known trajectories from ``p`` (B, np) and their costs (B,), with ``workers`` solver processes, one per core.

    Each is the best of the solutions from stored neighbours, those of the nearest neighbour among ``methods``, by
    default the shipped ones. Where it costs more than the ``reference`` (B,), if given, the instance is solved from the
    plan of every expert of the first mixture, too. Solved batches are kept in the folder ``keep``, so that an
    interrupted run continues; a batch counts for its problem, parameters and guesses alone.
    """
    methods = shipped(problem) if methods is None else methods
    nearest = next((method.actor for method in methods if isinstance(method.actor, NearestPlanner)), None)
    known, experts = np.full(len(p), np.inf) if reference is None else reference, experts_of(methods)
    local = threading.local()

    def best(share: Array, guessers: tuple[Planner, ...]) -> tuple[Array, Array]:
        if not hasattr(local, "solver"):
            local.solver = GuardedSolver(problem)
        trajectory, costs = optimal_planner(problem, nearest, guessers, local.solver).best(share)
        return trajectory.flat(), costs

    def solve(begin: int) -> tuple[Trajectory, Array]:
        share, aim = p[begin : begin + SHARE], known[begin : begin + SHARE] * (1 + SAME)
        path = None if keep is None else keep / f"{_key(problem, share, nearest, experts)}.npz"
        nothing = np.full((len(share), problem.flat_size), np.nan), np.full(len(share), np.inf)
        flat, costs = (None if path is None else _read(path, nothing[0].shape)) or nothing
        before = costs.copy()
        # An instance that is not solved may have exceeded the time limit on a busy machine.
        if (lost := ~np.isfinite(costs)).any():
            flat[lost], costs[lost] = best(share[lost], ())
        if experts and (worse := costs > aim).any():
            found, cheaper = best(share[worse], experts)
            flat[worse], costs[worse] = found, cheaper
        if path is not None and not np.array_equal(before, costs):
            write_arrays(path, {"flat": flat, "costs": costs})
        return problem.unflatten(flat), costs

    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        shares = range(0, len(p), SHARE)
        solved = pool.map(solve, shares)
        parts = list(track(solved, len(shares), unit="part", label="optimal trajectories", leave=False))
    return Trajectory.concatenate([plan for plan, _ in parts]), np.concatenate([cost for _, cost in parts])


def _key(problem: OptimalControlProblem, p: Array, nearest: NearestPlanner | None, guessers: Sequence[Planner]) -> str:
    """A hash of everything that a batch of optimal trajectories depends on."""
    sha = hashlib.sha256(f"{problem.fingerprint} {lookaround_of(problem)}".encode())
    stored = () if nearest is None else (nearest.parameters, nearest.trajectory.flat())
    # A guesser is known by its plan; one of the batch suffices to tell networks apart.
    for array in (p, *stored, *(guesser(p[:1]).flat() for guesser in guessers)):
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()[:16]


def _read(path: Path, shape: tuple[int, int]) -> tuple[Array, Array] | None:
    """Flat trajectories and costs that were kept; ``None`` where they are missing or damaged."""
    try:
        kept = read_arrays(path)
        flat, costs = np.asarray(kept["flat"], dtype=np.float64), np.asarray(kept["costs"], dtype=np.float64)
    except (DamagedFileError, KeyError):
        return None
    return (flat, costs) if flat.shape == shape and costs.shape == shape[:1] else None
