"""Scores: a method on the fixed instances of a problem, and the table of several methods.

The instances are those of the shipped splits: ``uniform`` (the validation set), ``boundary`` (near the discontinuity of
the optimum), ``outside`` (outside the parameter box) and ``near`` (near the goal). A planner is tracked with LQR, a
policy acts. All results are those of the simulator, whatever wraps the method, and costs are relative to the tracked
optimum (:mod:`moe_policy.score.optimum`).
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.protocols import Planner, Policy
from moe_policy.reports.metric_columns import spreads_of
from moe_policy.reports.records import Record
from moe_policy.reports.split_table import SPLIT_COLUMNS, Line, by_split
from moe_policy.reports.tables import markdown_table
from moe_policy.rollouts.metrics import Metrics, evaluate
from moe_policy.score.method import Method
from moe_policy.score.optimum import TrackedOptimum, shipped_guesses, solve_all
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.sets import reference
from ocp_envs.sets.reference import SPLITS
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.libraries import cache_folder
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import Provenance, provenance

#: Makes a planner or a policy for a problem; with an argument ``seed``, for that training seed.
Factory = Callable[..., Planner | Policy]
#: The splits of a score by default: those of interest for every method.
USUAL = ("uniform", "boundary", "outside")
#: Control period of a policy that names none, seconds.
PERIOD = 0.02


@checked
@dataclass(frozen=True, kw_only=True)
class ScoreRun(Record):
    """A method made with one seed.

    Args:
        seed: given to the factory; ``None`` where it takes none.
        making_seconds: duration of making it, with its training.
        parameters_total: number of its weights or stored values, where it says so.
        splits: its metrics by split.
    """

    seed: int | None
    making_seconds: float
    parameters_total: int | None
    splits: dict[str, Metrics]


@checked
@dataclass(frozen=True, kw_only=True)
class Score(Record):
    """A method on the splits of a problem: ``score_<method>_<env>.json``.

    Args:
        env_id: id of the problem.
        method: name of the method.
        factory: what made it, in words.
        kind: ``"planner"`` or ``"policy"``.
        dt: control period, seconds.
        cases: numbers of instances by split.
        optimal_solved: numbers of those whose optimum was solved, and which count for the cost.
        runs: one for each seed.
        seconds: duration of the whole.
        provenance: versions, machine and date.
    """

    env_id: str
    method: str
    factory: str
    kind: str
    dt: float
    cases: dict[str, int]
    optimal_solved: dict[str, int]
    runs: tuple[ScoreRun, ...]
    seconds: float
    provenance: Provenance

    @property
    def table(self) -> str:
        """The metrics as a Markdown table."""
        return table([self])


def splits_of(problem: ProblemOrId) -> list[str]:
    """The splits for which instances of ``problem`` are shipped, in the order of tables."""
    problem = problem_of(problem)
    there = ("validation", *sets_of(problem).hard)
    return [name for name, kept in SPLITS.items() if kept in there and reference.path_of(problem, kept).is_file()]


@checked
def score_method(
    problem: ProblemOrId,
    factory: Factory,
    *,
    name: str,
    splits: Sequence[str] | None = None,
    cases: int | None = None,
    seeds: Sequence[int] | None = None,
    keep: Path | None = None,
    workers: int | None = None,
) -> Score:
    """Make a method with ``factory`` and measure it on the fixed instances of ``problem``.

    Args:
        problem: a problem of the benchmark.
        factory: called with the problem, and with ``seed`` if it has such an argument; returns a planner or a policy.
        name: of the method in tables.
        splits: which ones; by default ``uniform``, ``boundary`` and ``outside``, as far as the problem has them.
        cases: the first so many instances of each split; all by default.
        seeds: one method is made for each; by default 0, or none where the factory takes no seed.
        keep: folder in which the optima are kept for the next score; by default in the user's cache folder.
        workers: processes that solve the optima; one per core by default.

    Raises:
        ValueError: a split that the problem does not have, no splits at all, fewer than one case, or seeds for a
            factory that takes none.
        TypeError: the factory returns neither a planner nor a policy.
    """
    problem, began = problem_of(problem), time.perf_counter()
    given = _seeds(factory, seeds)
    sets = _sets(problem, splits, cases)
    made = [_made(problem, factory, seed) for seed in given]
    optima = _optima(problem, sets, keep, workers)
    dt = getattr(made[0][0], "dt", PERIOD)
    runs = [
        _run(problem, Method(name, actor, seconds=took), seed, dt, optima) for seed, (actor, took) in zip(given, made)
    ]
    return Score(
        env_id=problem.id,
        method=name,
        factory=f"{getattr(factory, '__module__', '')}:{getattr(factory, '__qualname__', type(factory).__name__)}",
        kind="policy" if isinstance(made[0][0], Policy) else "planner",
        dt=dt,
        cases={split: len(cases) for split, cases in sets.items()},
        optimal_solved={split: int(np.isfinite(found.costs).sum()) for split, found in optima.items()},
        runs=tuple(runs),
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )


def _seeds(factory: Factory, seeds: Sequence[int] | None) -> list[int | None]:
    try:
        takes = "seed" in inspect.signature(factory).parameters
    except ValueError:  # a class of Python's own
        takes = False
    if seeds is not None and not takes:
        raise ValueError("seeds: the factory has no argument 'seed'; leave them out, or give it one")
    return list(seeds if seeds is not None else (0,)) if takes else [None]


def _sets(
    problem: OptimalControlProblem, splits: Sequence[str] | None, cases: int | None
) -> dict[str, reference.ReferenceSet]:
    """The instances by split, the first ``cases`` of each."""
    there = splits_of(problem)
    if not there:
        raise ValueError(f"{problem.id}: no instances are shipped for it, so it has no scores; moe_policy.compare has")
    if cases is not None:
        check_whole("cases", cases, 1, 10**9)
    chosen = [split for split in USUAL if split in there] if splits is None else list(splits)
    for split in chosen:
        if split not in there:
            raise ValueError(f"splits: {problem.id} has no {split!r}; there are {', '.join(there)}")
    return {split: reference.load(problem, SPLITS[split])[:cases] for split in chosen}


def _made(problem: OptimalControlProblem, factory: Factory, seed: int | None) -> tuple[Planner | Policy, float]:
    """What ``factory`` returns, and the seconds that it took."""
    began = time.perf_counter()
    actor = factory(problem) if seed is None else factory(problem, seed=seed)
    if not isinstance(actor, Policy) and not callable(actor):
        raise TypeError(
            f"the factory returned a {type(actor).__name__}; expected a planner, which is called with parameters, or a "
            "policy, which has the method predict"
        )
    return actor, time.perf_counter() - began


def _optima(
    problem: OptimalControlProblem, sets: dict[str, reference.ReferenceSet], keep: Path | None, workers: int | None
) -> dict[str, TrackedOptimum]:
    """The tracked optima by split, solved or kept from an earlier score."""
    nearest, experts = shipped_guesses(problem)
    folder = cache_folder() / "optimal" / problem.id if keep is None else keep
    found = {}
    for split, cases in track(sets.items(), len(sets), unit="split", label="tracked optimum", leave=False):
        p, cost = cases.parameters, cases.cost
        solved = solve_all(problem, p, nearest, experts, folder, workers, cost)
        found[split] = TrackedOptimum.of(problem, p, *solved, cost)
    return found


def _run(
    problem: OptimalControlProblem, method: Method, seed: int | None, dt: float, optima: dict[str, TrackedOptimum]
) -> ScoreRun:
    metrics = {}
    for split, optimum in track(optima.items(), len(optima), unit="split", label=method.name, leave=False):
        p: Array = optimum.episodes.parameters
        metrics[split] = evaluate(problem, method.fly(problem, p, dt), optimum.baseline)
    return ScoreRun(
        seed=seed,
        making_seconds=method.seconds or 0.0,
        parameters_total=getattr(method.actor, "parameters_total", None),
        splits=metrics,
    )


def table(scores: Sequence[Score]) -> str:
    """The Markdown table of ``scores`` of one problem: for each split a line for each method.

    Several seeds have their median and range. Methods stand in the order of their success at the plan's end.

    Raises:
        ValueError: no scores, or scores of several problems.
    """
    problems = {score.env_id for score in scores}
    if len(problems) != 1:
        raise ValueError(f"expected scores of one problem, got those of {sorted(problems) or 'none'}")
    splits = [split for split in SPLITS if any(split in score.cases for score in scores)]
    found = []
    for split in splits:
        there = [score for score in scores if split in score.cases]
        found += [_line(split, score) for score in sorted(there, key=lambda score: _order(score, split))]
    return markdown_table(by_split(found), SPLIT_COLUMNS)


def _line(split: str, score: Score) -> Line:
    title, metrics = f"{split}, of {score.cases[split]:,}", [run.splits[split] for run in score.runs]
    if len(metrics) == 1:
        return Line(title, score.method, metrics[0])
    return Line(title, f"{score.method}, {len(metrics)} seeds", spreads=spreads_of(metrics))


def _order(score: Score, split: str) -> float:
    found = [run.splits[split] for run in score.runs]
    return -float(np.median([(one.success_at_plan_end or one.success).fraction for one in found]))
