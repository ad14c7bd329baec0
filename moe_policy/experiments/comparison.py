"""The comparison of methods from the same initial conditions: one row each, and the table of the rows.

A planner is tracked with LQR and the goal is regulated after its plan. A learned policy acts until it first enters the
goal ball; from then on the goal is regulated, too, where the problem allows it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.latency import time_planner
from moe_policy.experiments.methods import solve_all
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.prediction_error import validation_error
from moe_policy.reports.metric_columns import METRICS
from moe_policy.reports.records import ABSENT, Absent, Record, inline, present, renamed
from moe_policy.reports.tables import Column, duration
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.metrics import Metrics, evaluate
from moe_policy.score.method import Method
from moe_policy.score.optimum import TrackedOptimum
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class ComparisonRow(Record):
    """One method of a comparison."""

    name: str  # of the method
    data: str | None  # what it learnt from; ``None`` where nothing was learnt
    training_seconds: float | None  # of its training without that of data; ``None`` where nothing was learnt
    metrics: Metrics = inline()  # of its episodes; costs are compared with the tracked optimum
    planning_seconds: dict[str, float] | Absent = ABSENT  # seconds per plan by batch size, of a planner
    parameters_total: int | None  # number of its weights or stored values; ``None`` where it has none
    parameters_active: int | None  # number of those that one plan uses
    test_error: float | Absent = ABSENT  # smooth L1 loss of a network on its test split
    validation_error: float | Absent | None = ABSENT  # of its predictions; ``None`` without a known optimum


@dataclass(frozen=True, kw_only=True)
class CostDifference(Record):
    """How far the costs of the optimal planner are from the reference, |J / J_ref − 1|."""

    within: int = renamed("within_0.1_percent")  # number of cases within 0.1 %
    largest: float  # maximum over the solved cases

    @classmethod
    def of(cls, costs: Array, reference: Array) -> CostDifference:
        """The difference of ``costs`` (B,), not finite where unsolved, from ``reference`` (B,)."""
        difference = np.abs(costs / reference - 1)
        within = int((difference < 1e-3).sum())
        return cls(within=within, largest=float(difference[np.isfinite(difference)].max(initial=0.0)))


@dataclass(frozen=True, kw_only=True)
class Comparison(Record):
    """All methods of one problem on the validation set: ``compare_<env>.json`` and ``compare_trained_<env>.json``."""

    env_id: str  # id of the problem
    cases: int  # number of initial conditions
    seed: int  # of the training, where the models were made for the comparison
    reference_difference: CostDifference = renamed("reference_gap")  # of the optimal planner's costs from the reference
    seconds: float  # duration of the run
    rows: tuple[ComparisonRow, ...]  # one for each method
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class MarginRow(Record):
    """One planner with one margin."""

    margin: float | None  # added to the parameter; ``None`` for the optimum
    row: ComparisonRow = inline()  # as in a comparison


@dataclass(frozen=True, kw_only=True)
class Margins(Record):
    """Planners that are asked to exceed a parameter by several margins: ``margin_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    parameter: str  # name of the parameter that is enlarged
    cases: int  # number of initial conditions
    rows: tuple[MarginRow, ...]  # the optimum, then all margins of each planner
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class TrackingRow(Record):
    """One planner tracked with one choice of weights Q = I, R = r I."""

    control: float  # r
    terminal: float | None  # s of the terminal weight s I; ``None`` for that of the infinite horizon
    room: float  # control authority ρ that is left for tracking
    row: ComparisonRow = inline()  # as in a comparison


@dataclass(frozen=True, kw_only=True)
class TrackingChoice(Record):
    """A grid of tracking weights: ``tracking_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    cases: int  # number of initial conditions
    rows: tuple[TrackingRow, ...]  # all planners with each choice
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Record):
    """A comparison on a changed problem: ``sensitivity_<env>.json``."""

    env_id: str  # id of the changed problem
    cases: int  # number of initial conditions
    rows: tuple[ComparisonRow, ...]  # one for each method
    provenance: Provenance  # of the record


def run(
    problem: OptimalControlProblem,
    method: Method,
    parameters: Array,
    *,
    optimal: Trajectory | None = None,
    baseline: Episodes | None = None,
    dt: float = 0.02,
    weights: TrackingWeights | None = None,
    batches: tuple[int, ...] = (1, 1000),
) -> tuple[ComparisonRow, Episodes]:
    """Roll ``method`` out from ``parameters`` (B, np) and evaluate it: the row and the episodes.

    ``optimal`` trajectories serve the prediction error of networks. Costs are compared with those of ``baseline``, by
    default the method's own; ``weights`` are the problem's own by default; planning is timed for the sizes ``batches``.
    """
    episodes = method.fly(problem, parameters, dt, weights)
    planner = method.planner
    network = planner if isinstance(planner, NetworkPlanner) else None
    row = ComparisonRow(
        name=method.name,
        data=method.data,
        training_seconds=method.seconds,
        metrics=evaluate(problem, episodes, episodes if baseline is None else baseline),
        planning_seconds=ABSENT if planner is None else time_planner(planner, parameters, batches),
        parameters_total=getattr(method.actor, "parameters_total", None),
        parameters_active=getattr(method.actor, "parameters_active", None),
        test_error=ABSENT if network is None else network.details["training"]["test_error"],
        validation_error=ABSENT if network is None else _prediction(network, parameters, optimal),
    )
    return row, episodes


@dataclass(frozen=True, eq=False)
class Optimum(TrackedOptimum):
    """The tracked optimum with its row, named ``optimal``."""

    row: ComparisonRow


def track_optimum(
    problem: OptimalControlProblem,
    parameters: Array,
    reference: Array,
    methods: Sequence[Method],
    keep: Path,
    workers: int | None = None,
) -> Optimum:
    """Solve the instances with ``parameters`` (B, np) and track their solutions.

    ``reference`` (B,) are the best known costs. Guesses come from ``methods``, ``workers`` processes solve, and solved
    batches are kept in the folder ``keep``, as in :func:`~moe_policy.experiments.methods.solve_all`.
    """
    found = solve_all(problem, parameters, methods, keep, workers, reference)
    tracked = TrackedOptimum.of(problem, parameters, *found, reference)
    row = ComparisonRow(
        name="optimal",
        data=None,
        training_seconds=None,
        metrics=evaluate(problem, tracked.episodes, tracked.baseline),
        parameters_total=None,
        parameters_active=None,
    )
    return Optimum(tracked.trajectories, tracked.costs, tracked.episodes, tracked.baseline, row)


def _prediction(planner: NetworkPlanner, parameters: Array, optimal: Trajectory | None) -> float | None:
    if optimal is None or not (known := optimal.finite).any():
        return None
    return validation_error(planner, parameters[known], optimal[known])


def _planning(size: str) -> Callable[[ComparisonRow], float | None]:
    return lambda row: (present(row.planning_seconds) or {}).get(size)


COLUMNS: tuple[Column[ComparisonRow], ...] = (
    Column("policy", lambda row: row.name),
    *(metric.column.of_part(lambda row: row.metrics) for metric in METRICS),
    Column("error at the plan's end", lambda row: row.metrics.plan_end_error_median, ".2g"),
    Column("test error", lambda row: row.test_error, ".2g"),
    Column("validation error", lambda row: row.validation_error, ".2g"),
    Column("plan, batch 1", _planning("1"), duration),
    Column("… batch 1000", _planning("1000"), duration),
    Column("learnt from", lambda row: row.data),
    Column("weights", lambda row: row.parameters_total, ","),
    Column("… active", lambda row: row.parameters_active, ","),
    Column("training", lambda row: row.training_seconds, duration),
)
