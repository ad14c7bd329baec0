"""The tracked optimum of many instances: what the costs of methods are compared with."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from moe_policy import store
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts
from moe_policy.planners.solver import BatchSolver, SolverPlanner, lookaround_of
from moe_policy.planners.stored import StoredPlans
from moe_policy.protocols import Planner
from moe_policy.rollouts.episodes import Episodes
from moe_policy.score.method import Method
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
class TrackedOptimum:
    """The best known trajectories of B instances, tracked.

    Args:
        trajectories: B of them.
        costs: of the trajectories, (B,); +inf where none is known.
        episodes: of the tracked trajectories.
        baseline: the same at the cost of the reference: where a trajectory costs more than the reference, its episode
            costs less in the same ratio.
    """

    trajectories: Trajectory
    costs: Array
    episodes: Episodes
    baseline: Episodes

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, parameters: Array, trajectories: Trajectory, costs: Array, reference: Array
    ) -> TrackedOptimum:
        """The ``trajectories`` from ``parameters`` (B, np) on ``problem``, tracked.

        ``costs`` (B,) are those of the trajectories, ``reference`` (B,) the best known ones.
        """
        episodes = Method("optimal", StoredPlans(parameters, trajectories)).fly(problem, parameters)
        baseline = replace(episodes, cost=episodes.cost * np.minimum(1.0, reference / costs))
        return cls(trajectories, costs, episodes, baseline)


def shipped_guesses(problem: OptimalControlProblem) -> tuple[NearestPlanner | None, tuple[Planner, ...]]:
    """What the optima of ``problem`` are solved from: the shipped neighbours, and the experts of a shipped mixture."""
    names = sorted(name for name in store.available(problem) if name.startswith("moe-"))
    for name in sorted(names, key=lambda name: name != "moe-custom"):
        planner = store.load(problem, name, kind=NetworkPlanner)
        if isinstance(planner.network, MixtureOfExperts):
            return store.shipped_nearest(problem), planner.expert_planners()
    return store.shipped_nearest(problem), ()


def optimal_planner(
    problem: OptimalControlProblem,
    nearest: NearestPlanner | None = None,
    guessers: Sequence[Planner] = (),
    solver: BatchSolver | None = None,
) -> SolverPlanner:
    """The ``solver`` as a planner for ``problem``.

    It is warm-started from ``nearest``, by default the shipped one if any, and from ``guessers``.
    """
    nearest = store.shipped_nearest(problem) if nearest is None else nearest
    return SolverPlanner(problem, nearest, guessers=guessers, solver=solver)


def solve_all(
    problem: OptimalControlProblem,
    p: Array,
    nearest: NearestPlanner | None,
    experts: tuple[Planner, ...] = (),
    keep: Path | None = None,
    workers: int | None = None,
    reference: Array | None = None,
) -> tuple[Trajectory, Array]:
    """Best known trajectories from ``p`` (B, np) and their costs (B,), with ``workers`` solver processes, one per core.

    Each is the best of the solutions from stored neighbours, those of ``nearest``, by default the shipped ones. Where
    it costs more than the ``reference`` (B,), if given, the instance is solved from the plan of each of the
    ``experts``, too. Solved batches are kept in the folder ``keep``, so that an interrupted run continues; a batch
    counts for its problem, parameters and guesses alone.
    """
    known = np.full(len(p), np.inf) if reference is None else reference
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
