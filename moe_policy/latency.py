"""How long planning, solving and one control step take, measured side by side.

What is compared takes turns, a few problems at a time, so that other load on the machine meets all alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from moe_policy.comparison import Contestant
from moe_policy.optimal import BatchSolver
from moe_policy.policy import Planner, PlanningPolicy
from moe_policy.rollout import environments
from moe_policy.scaling import Array
from ocp_envs.guesses import guesses, random_kind
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.trajectory import Trajectory

#: Problems that one way of starting the solver gets before it is the next one's turn.
TURN = 10
#: A solution costs no more than this above the best known one to be it, relatively.
SAME = 1e-3
#: p (B, np) → row of p, guess and index of the goal's winding (−1: the one nearest to the guess's end) of every solve.
Start = Callable[[Array], tuple[NDArray[np.int64], Trajectory, NDArray[np.int64]]]


def cold(problem: OptimalControlProblem, kind: str, seed: int = 0) -> Start:
    """A guess to every winding of the goal: ``"line"`` or ``"random"``, as the multistart draws them."""

    def start(p: Array) -> tuple[NDArray[np.int64], Trajectory, NDArray[np.int64]]:
        count = len(problem.targets)
        rows, windings = np.repeat(np.arange(len(p)), count), np.tile(np.arange(count), len(p))
        rng = np.random.default_rng((seed, *p[0].view(np.uint64).tolist()))
        drawn = "line" if kind == "line" else random_kind(problem)
        return rows, guesses(problem, p[rows], windings, rng, drawn), windings

    return start


def warm(planner: Planner) -> Start:
    """The plan of ``planner``, to the goal nearest to its end."""

    def start(p: Array) -> tuple[NDArray[np.int64], Trajectory, NDArray[np.int64]]:
        return np.arange(len(p)), planner(p), np.full(len(p), -1)

    return start


def solver_rows(
    problem: OptimalControlProblem,
    solver: BatchSolver,
    starts: Mapping[str, Start],
    p: Array,
    best: Array,
) -> list[dict[str, Any]]:
    """What a solve costs from each way of starting it, and how often it ends at the best known cost.

    Args:
        problem: the problem.
        solver: what solves.
        starts: ways of starting by name.
        p: problems, (B, np).
        best: best known costs, (B,).

    Returns:
        for each way: solves, those that were verified, problems with a solution and with the best one (by the cheapest
        of its solves), median iterations and milliseconds of a solve, and wall time for each problem.
    """
    kept: dict[str, list[tuple[Any, ...]]] = {name: [] for name in starts}
    for start in starts.values():  # a first few solves warm up
        rows, guess, windings = start(p[:2])
        solver.solve(p[:2][rows], guess, windings, persist=False)
    for begin in range(0, len(p), TURN):
        part = p[begin : begin + TURN]
        for name, start in starts.items():
            began = time.perf_counter()
            rows, guess, windings = start(part)
            found = solver.solve(part[rows], guess, windings, persist=False)
            seconds = time.perf_counter() - began
            cheapest = np.full(len(part), np.inf)
            np.minimum.at(cheapest, rows, found.cost)
            kept[name].append((found.solved, found.iterations, found.seconds, cheapest, seconds))
    result = []
    for name, parts in kept.items():
        solved, iterations, each, cheapest = (np.concatenate(values) for values in list(zip(*parts))[:4])
        middle = np.median if solved.any() else (lambda values: np.nan)
        result.append(
            {
                "name": name,
                "problems": len(p),
                "solves": len(solved),
                "verified": int(solved.sum()),
                "solved_problems": int(np.isfinite(cheapest).sum()),
                "best_known": int((cheapest <= best * (1 + SAME)).sum()),
                "iterations_median": float(middle(iterations[solved])),
                "milliseconds_median": float(1e3 * middle(each[solved])),
                "seconds_per_problem": sum(part[-1] for part in parts) / len(p),
            }
        )
    return result


def step_rows(
    problem: OptimalControlProblem, contestants: Sequence[Contestant], p: Array, dt: float = 0.02, ticks: int = 50
) -> list[dict[str, Any]]:
    """Seconds of the first decision of an episode and of each later one, for one environment.

    The first one plans, and sets up the regulators along the plan.

    Args:
        problem: the problem.
        contestants: who acts.
        p: starts, (B, np), an episode each; the first one warms up.
        dt: control period, seconds.
        ticks: of an episode.

    Returns:
        medians by contestant, and their share of the control period.
    """
    policies = {contestant.name: contestant.policy(problem, dt) for contestant in contestants}
    first: dict[str, list[float]] = {name: [] for name in policies}
    later: dict[str, list[float]] = {name: [] for name in policies}
    envs = environments(problem, 1, dt)
    for number, row in enumerate(p):
        for name, policy in policies.items():
            observation, _ = envs.reset(options={"parameters": row[None], "extrapolate": True})
            taken, state = [], None
            for tick in range(ticks):
                began = time.perf_counter()
                if tick == 0 and isinstance(policy, PlanningPolicy):
                    state = policy.start(row[None])
                action, state = policy.predict(observation, state, np.array([tick == 0 and state is None]))
                taken.append(time.perf_counter() - began)
                observation, _, terminated, _, _ = envs.step(action)
                if terminated.any():
                    break
            if number:
                first[name].append(taken[0])
                later[name] += taken[1:]
    envs.close()
    return [
        {
            "name": name,
            "first_seconds": float(np.median(first[name])),
            "step_seconds": float(np.median(later[name])),
            "step_share_of_period": float(np.median(later[name])) / dt,
        }
        for name in policies
    ]
