"""The comparison of planners and policies on the same starts: how each becomes a policy, and its row of the table.

A planner is tracked with LQR and holds the goal after its plan. A learned policy acts until it first enters the goal
ball and then holds the goal too, where the goal can be held. Rows are plain records, as they stand in the JSON files;
the columns say how they are written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from moe_policy.control.weights import TrackingWeights
from moe_policy.experiments.figures.comparison import Outcome
from moe_policy.experiments.latency import time_planner
from moe_policy.experiments.methods import Method
from moe_policy.experiments.tables import duration, keyed, proportion
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.prediction_error import validation_error
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import evaluate
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: Episodes that run at once; a plan's gains, references and metrics for 10,000 episodes do not fit into memory.
BATCH = 500


def run(
    problem: OptimalControlProblem,
    method: Method,
    starts: Array,
    *,
    optimal: Trajectory | None = None,
    baseline: Episodes | None = None,
    dt: float = 0.02,
    weights: TrackingWeights | None = None,
    batches: tuple[int, ...] = (1, 1000),
) -> tuple[dict[str, Any], Episodes]:
    """Roll ``method`` out from ``starts`` and describe how it did.

    Args:
        problem: the problem.
        method: who acts.
        starts: parameters of the episodes, (B, np).
        optimal: the optimal trajectories from them, for the prediction error of networks.
        baseline: the episodes costs are compared with; a method's own where not given.
        dt: control period, seconds.
        weights: of tracking and hold; the problem's own where not given.
        batches: sizes of the batches whose planning is timed.

    Returns:
        the row as a JSON record, and the episodes.
    """
    envs = environments(problem, min(len(starts), BATCH), dt)
    episodes = rollout(envs, method.policy(problem, dt, weights), starts)
    envs.close()
    planner = method.planner
    row: dict[str, Any] = {"name": method.name, "data": method.data, "training_seconds": method.seconds}
    row |= evaluate(problem, episodes, episodes if baseline is None else baseline).record()
    if planner is not None:
        row["planning_seconds"] = {str(k): v for k, v in time_planner(planner, starts, batches).items()}
    for size in ("parameters_total", "parameters_active"):
        row[size] = getattr(method.actor, size, None)
    if isinstance(planner, NetworkPlanner):
        row["test_error"] = planner.details["training"]["test_error"]
        row["validation_error"] = None
        if optimal is not None and optimal.finite.any():
            known = optimal.finite
            row["validation_error"] = validation_error(planner, starts[known], optimal[known])
    return row, episodes


def outcome(name: str, episodes: Episodes, problem: OptimalControlProblem) -> Outcome:
    """What the comparison's figure shows of ``episodes``."""
    metrics = evaluate(problem, episodes)
    errors = episodes.plan_end_error if metrics.success_at_plan_end is not None else None
    return Outcome(name, metrics.success, metrics.success_at_plan_end, errors)


# -- the table ---------------------------------------------------------------------------------------------------------


def _share(record: Mapping[str, Any]) -> str:
    return proportion(Proportion(record["count"], record["total"]))


def _of(key: str, form: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda record: form(record[key]) if record.get(key) is not None else "–"


COLUMNS = (
    keyed("name", "policy"),
    keyed("reached", "reached", lambda record: str(record["count"])),
    keyed("success", "success (95 % interval)", _share),
    keyed("success_at_plan_end", "… at the plan's end", _share),
    keyed("plan_end_error_median", "error there", ".2g"),
    keyed("knot_violation_mean", "mean violation at knots, m", ".3f"),
    keyed("violation_mean", "… on the whole path", ".3f"),
    keyed("cost_ratio", "cost / optimal", _of("ratio", "{:.3f}".format)),
    keyed("test_error", "test error", ".2g"),
    keyed("validation_error", "validation error", ".2g"),
    keyed("planning_seconds", "plan, batch 1", _of("1", duration)),
    keyed("planning_seconds", "… batch 1000", _of("1000", duration)),
    keyed("data", "learnt from"),
    keyed("parameters_total", "weights", ","),
    keyed("parameters_active", "… active", ","),
    keyed("training_seconds", "training", duration),
)


def _error(value: float) -> str:
    """Three decimals; two digits where these would say nothing."""
    return f"{value:.3f}" if value >= 1e-3 else f"{value:.2g}"


def _median(record: Mapping[str, float]) -> str:
    return f"{record['median']:.0f} ({record['least']}–{record['most']})"


#: The table of training variants: medians over seeds, and their range.
TRAINING_COLUMNS = (
    keyed("name", "model"),
    keyed("samples", "training problems", ","),
    keyed("success_spread", "success, median (range)", _median),
    keyed("paper_success", "paper", "d"),
    keyed("success_at_plan_end_spread", "at the plan's end", _median),
    keyed("knot_violation_spread", "mean violation at knots, m", _of("median", "{:.3f}".format)),
    keyed("paper_violation", "paper", ".3f"),
    keyed("violation_spread", "… on the whole path", _of("median", "{:.3f}".format)),
    keyed("validation_error_spread", "validation error", _of("median", _error)),
    keyed("paper_validation_error", "paper", _error),
    keyed("test_error_spread", "test error", _of("median", "{:.4f}".format)),
)
