"""Who takes part: the shipped planners and policies of a problem, and its optimal trajectories."""

from __future__ import annotations

import hashlib
import json
import os
import threading
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from moe_policy import store
from moe_policy.control.stabiliser import Stabilised, Stabiliser
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.solver import SolverPlanner, lookaround_of
from moe_policy.planners.symmetric import Symmetrised
from moe_policy.protocols import Planner, Policy
from moe_policy.rl.actor import LearnedPolicy
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.files import replacing
from ocp_envs.trajectory import Trajectory

#: Starts of one share of the optimal planner's work.
SHARE = 250


@dataclass(frozen=True, eq=False)
class Method:
    """Somebody who takes part.

    Args:
        name: one of the shipped names, such as ``"moe-custom"``.
        actor: a planner (called with p) or a policy (with ``predict``).
        data: what it learnt from, for the table.
        seconds: what learning took, without the making of the data; ``None`` where nothing was learnt.
    """

    name: str
    actor: Planner | Policy
    data: str | None = None
    seconds: float | None = None

    @property
    def planner(self) -> Planner | None:
        """The actor if it plans."""
        return None if isinstance(self.actor, Policy) else self.actor

    def policy(self, problem: OptimalControlProblem, dt: float, weights: TrackingWeights | None = None) -> Policy:
        """The actor as a policy of control period ``dt``; ``weights`` are those of tracking and hold."""
        if self.planner is not None:
            return TrackingPolicy(problem, self.planner, dt, weights)
        acting: Any = self.actor
        if isinstance(acting, Stabiliser) or problem.hold == 0:
            return acting
        return Stabilised(acting, problem, dt, weights)


def solutions(count: int) -> str:
    """What a planner learnt from, in words."""
    return f"{count:,} solutions"


def steps(count: int) -> str:
    """What a reinforcement learner learnt from, in words."""
    return f"{count:,} steps"


def shipped(problem: OptimalControlProblem, results: Path | None = None) -> list[Method]:
    """The models of the package that the problem's benchmark compares: nearest neighbour, networks, learners.

    Args:
        problem: the problem; one without shipped models has none.
        results: folder of the learners' training records, from which steps and wall times are taken; without it the
            policies themselves tell their steps.
    """
    benchmark, there = benchmark_of(problem), store.available(problem)
    methods = []
    if (nearest := store.shipped_nearest(problem)) is not None:
        methods.append(Method("nearest", nearest, solutions(len(nearest.parameters))))
    for name in benchmark.planners.compared:
        if name in there:
            planner = store.load(problem, name, kind=NetworkPlanner)
            record = planner.details
            methods.append(Method(name, planner, solutions(record["samples"]), record["training"]["seconds"]))
    for name in benchmark.learners.settings:
        if name in there:
            policy = store.load(problem, name, kind=LearnedPolicy)
            training: dict[str, Any] = {"steps": policy.details["steps"], "seconds": None}
            record_path = None if results is None else results / f"training_{name}_{problem.id}.json"
            if record_path is not None and record_path.exists():
                training = json.loads(record_path.read_text())
            methods.append(Method(name, policy, steps(training["steps"]), training["seconds"]))
    return methods


def variants(problem: OptimalControlProblem, methods: Sequence[Method]) -> list[Method]:
    """The networks among ``methods`` once more, used with more care; none where the problem offers nothing.

    Averaged over the problem's symmetry (:class:`Symmetrised`), and keeping the margin of its benchmark
    (:class:`WithMargin`).
    """
    networks = [(c, c.actor) for c in methods if isinstance(c.actor, NetworkPlanner)]
    careful: list[tuple[Method, Symmetrised | WithMargin]] = []
    if problem.symmetry is not None:
        careful += [(method, Symmetrised(problem, planner)) for method, planner in networks]
    if margin := benchmark_of(problem).planners.margin:
        careful += [
            (method, WithMargin(problem, planner, margin.parameter, margin.amount)) for method, planner in networks
        ]
    return [replace(method, name=planner.name, actor=planner) for method, planner in careful]


def stabiliser(problem: OptimalControlProblem) -> list[Method]:
    """The hold without a plan, where the goal can be held."""
    return [Method("stabiliser", Stabiliser(problem))] if problem.hold else []


def optimal_planner(problem: OptimalControlProblem, nearest: NearestPlanner | None = None) -> SolverPlanner:
    """The solver as the comparison uses it.

    Args:
        problem: the problem.
        nearest: source of its warm starts; by default the shipped one, and random guesses where none is shipped.
    """
    return SolverPlanner(problem, store.shipped_nearest(problem) if nearest is None else nearest)


def solve_all(
    problem: OptimalControlProblem, p: Array, nearest: NearestPlanner | None = None, keep: Path | None = None
) -> tuple[Trajectory, Array]:
    """Optimal trajectories from ``p`` (B, np) and their costs (B,), with a solver process for every core.

    Args:
        problem: the problem.
        p: parameters, (B, np).
        nearest: source of warm starts, as for :func:`optimal_planner`.
        keep: folder where solved shares are kept and looked for, so that an interrupted run goes on; a share counts
            for its problem, parameters and warm starts alone.
    """
    local = threading.local()
    nearest = store.shipped_nearest(problem) if nearest is None else nearest

    def solve(begin: int) -> tuple[Trajectory, Array]:
        share = p[begin : begin + SHARE]
        path = None if keep is None else keep / f"{_key(problem, share, nearest)}.npz"
        nothing = np.full((len(share), problem.flat_size), np.nan), np.full(len(share), np.inf)
        flat, costs = (None if path is None else _read(path, nothing[0].shape)) or nothing
        # What was not solved may have been stopped for taking long on a busy machine.
        if (lost := ~np.isfinite(costs)).any():
            if not hasattr(local, "planner"):
                local.planner = optimal_planner(problem, nearest)
            found, costs[lost] = local.planner.best(share[lost])
            flat[lost] = found.flat()
            if path is not None:
                _write(path, flat, costs)
        return problem.unflatten(flat), costs

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        shares = range(0, len(p), SHARE)
        parts = list(tqdm(pool.map(solve, shares), total=len(shares), desc="optimal", disable=None, leave=False))
    return Trajectory.concatenate([plan for plan, _ in parts]), np.concatenate([cost for _, cost in parts])


def _key(problem: OptimalControlProblem, p: Array, nearest: NearestPlanner | None) -> str:
    """A hash of all that a share of optimal trajectories depends on."""
    sha = hashlib.sha256(f"{problem.fingerprint} {lookaround_of(problem)}".encode())
    for array in (p, *(() if nearest is None else (nearest.parameters, nearest.trajectory.flat()))):
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()[:16]


def _write(path: Path, flat: Array, costs: Array) -> None:
    with replacing(path) as file:
        np.savez(file, flat=flat, costs=costs)


def _read(path: Path, shape: tuple[int, int]) -> tuple[Array, Array] | None:
    """Flat trajectories and costs that were kept, ``None`` where they are not there or damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            flat, costs = file["flat"], file["costs"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError):
        return None
    return (flat, costs) if flat.shape == shape and costs.shape == shape[:1] else None
