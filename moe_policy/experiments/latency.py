"""How long planning, solving and one control step take, measured side by side.

What is compared takes turns, a few problems at a time, so that other load on the machine meets all alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import DASH, duration, keyed
from moe_policy.protocols import Planner
from moe_policy.rollouts.rollout import environments
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.guesses import NEAREST_WINDING, guesses, random_kind
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: Plans of a call. The solver takes its time over the large one.
BATCHES = (1, 1000)
#: Problems that one way of starting the solver gets before it is the next one's turn.
TURN = 10
#: A solution costs no more than this above the best known one to be it, relatively.
SAME = 1e-3
#: p (B, np) → row of p, guess and index of the goal's winding (−1: the one nearest to the guess's end) of every solve.
Start = Callable[[Array], tuple[NDArray[np.int64], Trajectory, NDArray[np.int64]]]


def time_planner(
    planner: Planner, parameters: ArrayLike, batches: tuple[int, ...] = (1, 1000), repeats: int = 5
) -> dict[int, float]:
    """Seconds per plan for each size of batch: the median over ``repeats`` calls after one to warm up.

    Args:
        planner: parameters (B, np) → plans.
        parameters: (n, np), n ≥ 1; repeated to fill a batch, and each call gets other rows where there are enough.
        batches: sizes of a call.
        repeats: timed calls for each size.
    """
    p = np.asarray(parameters, dtype=np.float64)
    seconds = {}
    for batch in batches:
        rows = np.arange((repeats + 1) * batch).reshape(repeats + 1, batch) % len(p)
        planner(p[rows[0]])
        taken = []
        for chosen in rows[1:]:
            began = time.perf_counter()
            planner(p[chosen])
            taken.append(time.perf_counter() - began)
        seconds[batch] = float(np.median(taken)) / batch
    return seconds


def planner_rows(
    planners: Mapping[str, Planner], p: Array, batches: Sequence[int], turns: int = 3, calls: int = 20
) -> list[dict[str, Any]]:
    """Seconds a plan of each planner, for each size of batch: the median over its calls.

    Args:
        planners: by name; the first one is what the others are compared with.
        p: parameters, (n, np), repeated to fill the calls.
        batches: sizes of a call.
        turns: how often it is each planner's turn; in each, a batch of 1 is planned ``calls`` times, a larger one once.
        calls: of a batch of 1 in a turn.

    Returns:
        for each planner ``seconds`` and ``ratio``, the first planner's time / its time, by batch (as text, for JSON).
    """
    taken: dict[str, dict[int, list[float]]] = {name: {batch: [] for batch in batches} for name in planners}
    for planner in planners.values():  # starts what has to be started
        planner(p[:2])
    for turn in range(turns):
        for name, planner in planners.items():
            for batch in batches:
                each = calls if batch == 1 else 1
                for call in range(turn * each, (turn + 1) * each):
                    rows = p[np.arange(call * batch, (call + 1) * batch) % len(p)]
                    began = time.perf_counter()
                    planner(rows)
                    taken[name][batch].append((time.perf_counter() - began) / batch)
    seconds = {name: {str(batch): float(np.median(t)) for batch, t in by.items()} for name, by in taken.items()}
    first = seconds[next(iter(planners))]
    return [
        {"name": name, "seconds": own, "ratio": {batch: first[batch] / value for batch, value in own.items()}}
        for name, own in seconds.items()
    ]


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
        return np.arange(len(p)), planner(p), np.full(len(p), NEAREST_WINDING)

    return start


def solver_rows(
    problem: OptimalControlProblem,
    solver: GuardedSolver,
    starts: Mapping[str, Start],
    p: Array,
    best: Array,
) -> list[dict[str, Any]]:
    """What a solve costs from each way of starting it, and how often it ends at the best known cost.

    Args:
        problem: the problem.
        solver: what solves.
        starts: ways of starting by name; the first one is what the others are compared with.
        p: problems, (B, np).
        best: best known costs, (B,).

    Returns:
        for each way: solves, those that were verified and those that hung; problems with a solution and with the best
        one (by the cheapest of its solves); median iterations and milliseconds of a verified solve, ``None`` without
        any; wall time for each problem, guesses, hangs and checks included, and ``ratio``, the first way's / its own.
    """
    kept: dict[str, list[tuple[Any, ...]]] = {name: [] for name in starts}
    for start in starts.values():  # a first few solves warm up
        rows, guess, windings = start(p[:2])
        solver.solve(p[:2][rows], guess, windings, retry_with_fallback=False)
    for begin in range(0, len(p), TURN):
        part = p[begin : begin + TURN]
        for name, start in starts.items():
            restarts, began = solver.restarts, time.perf_counter()
            rows, guess, windings = start(part)
            found = solver.solve(part[rows], guess, windings, retry_with_fallback=False)
            seconds, hung = time.perf_counter() - began, solver.restarts - restarts
            cheapest = np.full(len(part), np.inf)
            np.minimum.at(cheapest, rows, found.cost)
            kept[name].append((found.solved, found.iterations, found.seconds, cheapest, seconds, hung))
    result: list[dict[str, Any]] = []
    for name, parts in kept.items():
        solved, iterations, each, cheapest = (np.concatenate(values) for values in list(zip(*parts))[:4])
        seconds = sum(part[4] for part in parts) / len(p)
        result.append(
            {
                "name": name,
                "problems": len(p),
                "solves": len(solved),
                "verified": int(solved.sum()),
                "hung": sum(part[5] for part in parts),
                "solved_problems": int(np.isfinite(cheapest).sum()),
                "best_known": int((cheapest <= best * (1 + SAME)).sum()),
                "iterations_median": float(np.median(iterations[solved])) if solved.any() else None,
                "milliseconds_median": float(1e3 * np.median(each[solved])) if solved.any() else None,
                "seconds_per_problem": seconds,
                "ratio": result[0]["seconds_per_problem"] / seconds if result else 1.0,
            }
        )
    return result


def step_rows(
    problem: OptimalControlProblem, methods: Sequence[Method], p: Array, dt: float = 0.02, ticks: int = 50
) -> list[dict[str, Any]]:
    """Seconds of a control step of one environment, and of what a planner does before the first one.

    Args:
        problem: the problem.
        methods: who acts.
        p: starts, (B, np), B ≥ 2, an episode each; the first one warms up.
        dt: control period, seconds.
        ticks: of an episode.

    Returns:
        medians for each method: a plan and the setting up of the regulators along it, ``None`` where nothing is
        planned; a step after that, and its share of the control period.
    """
    policies = {method.name: method.policy(problem, dt) for method in methods}
    taken: dict[str, dict[str, list[float]]] = {name: {"plan": [], "regulators": [], "step": []} for name in policies}
    envs = environments(problem, 1, dt)
    for number, row in enumerate(p):
        for name, policy in policies.items():
            own = taken[name] if number else {"plan": [], "regulators": [], "step": []}
            observation, _ = envs.reset(options={"parameters": row[None], "extrapolate": True})
            state: Any = None
            if isinstance(policy, TrackingPolicy):
                began = time.perf_counter()
                plan = policy.planner(row[None])
                planned = time.perf_counter()
                state = policy.follow(plan, problem.start(row[None])[1])
                own["plan"].append(planned - began)
                own["regulators"].append(time.perf_counter() - planned)
            for tick in range(ticks):
                began = time.perf_counter()
                action, state = policy.predict(observation, state, np.array([tick == 0 and state is None]))
                own["step"].append(time.perf_counter() - began)
                observation, _, terminated, _, _ = envs.step(action)
                if terminated.any():
                    break
    envs.close()
    return [
        {"name": name}
        | {f"{what}_seconds": float(np.median(seconds)) if seconds else None for what, seconds in own.items()}
        | {"step_share_of_period": float(np.median(own["step"])) / dt}
        for name, own in taken.items()
    ]


# -- tables ------------------------------------------------------------------------------------------------------------


def planning_rows(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Planners and policies of a record of scripts/benchmark_planning.py, a row each: a plan, and a control step."""
    rows: dict[str, dict[str, Any]] = {}
    for row in (*record["planners"], *record["steps"]):
        rows[row["name"]] = rows.get(row["name"], {}) | row
    return list(rows.values())


def _at(batch: int, form: Callable[[Any], str]) -> Callable[[Mapping[str, Any]], str]:
    return lambda by_batch: form(by_batch[str(batch)]) if str(batch) in by_batch else DASH


PLANNING_COLUMNS = (
    keyed("name", "policy"),
    *(keyed("seconds", f"a plan, batch of {batch:,}", _at(batch, duration)) for batch in BATCHES),
    *(keyed("ratio", f"solver's time / its, {batch:,}", _at(batch, "{:,.3g}".format)) for batch in BATCHES),
    keyed("regulators_seconds", "regulators", duration),
    keyed("step_seconds", "a control step", duration),
    keyed("step_share_of_period", "share of the period", ".2%"),
)
SOLVER_COLUMNS = (
    keyed("name", "started from"),
    keyed("solves", "solves", "d"),
    keyed("verified", "verified", "d"),
    keyed("hung", "hung", "d"),
    keyed("problems", "problems", "d"),
    keyed("best_known", "at the best known cost", "d"),
    keyed("iterations_median", "iterations", ".0f"),
    keyed("milliseconds_median", "ms a solve", ".2f"),
    keyed("seconds_per_problem", "a problem", duration),
    keyed("ratio", "cold time / its time", ".2f"),
)
