"""Why a mixture of experts fails: one cause for every instance whose tracked plan misses the goal.

For such an instance other plans are tracked in the same way, and the first line that holds is the cause. The *right*
expert is that of the optimal solution family, where the clusters are the problem's families. For other clusters
(k-means) the right one is unknown, and every expert counts as right.

    tracker    the optimal trajectory fails when it is tracked
    gate       a right expert's plan succeeds: the gate chose another expert, or blended it with others
    data       no training sample to learn from is near: the nearest ones of the optimal family all fail when they are
               tracked from this initial state, or the family has no sample or no expert
    expert     all other failures: nearby samples succeed, but the right expert's plan does not

The order matters. Where the optimum itself fails no planner could succeed. The gate precedes expert and data because
the right expert's plan was available. A nearest sample that succeeds shows that the data were sufficient, but one that
fails does not prove that an expert could not have interpolated: ``data`` is an upper bound, and so is ``gate`` for
clusters that are not families, where some expert may succeed by chance. Two metrics describe a failure further: near a
discontinuity the relative cost difference of the two cheapest families is small, and the distance to the nearest
training sample of the family is that of the nearest-neighbour planner, every coordinate of p divided by the width of
its box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.failures import Cause, EvaluatedAt, Failure
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import Argmax, MixtureOfExperts
from moe_policy.planners.stored import StoredPlans
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from moe_policy.score.method import BATCH
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.trajectory import Trajectory


def explain(
    problem: OptimalControlProblem,
    planner: NetworkPlanner,
    cases: Samples,
    training: Samples,
    dt: float = 0.02,
    *,
    at: EvaluatedAt | str = EvaluatedAt.EVALUATION_TIME,
    neighbours: int = 3,
) -> list[Failure]:
    """Every instance of ``cases`` on which the mixture ``planner``, trained on ``training``, fails, with its cause.

    ``at`` says when tracked plans are evaluated; the data count as the cause where none of the nearest ``neighbours``
    training samples succeeds.

    Raises:
        TypeError: a planner without gate and experts.
        ValueError: no cases, no neighbours, an unknown ``at``, or parts made for different problems.
    """
    _check(problem, planner, cases, training, neighbours)
    trial = _Trial(problem, dt, EvaluatedAt(at))
    plan = planner(cases.parameters)
    episodes = trial.episodes(cases.parameters, plan)
    failed = np.flatnonzero(~trial.success(episodes))
    if not len(failed):
        return []
    return _failures(planner, cases[failed], plan[failed], episodes[failed], training, trial, neighbours)


def _check(
    problem: OptimalControlProblem, planner: NetworkPlanner, cases: Samples, training: Samples, neighbours: int
) -> None:
    if not (isinstance(planner, NetworkPlanner) and isinstance(planner.network, MixtureOfExperts)):
        name = getattr(planner, "name", type(planner).__name__)
        raise TypeError(f"expected a mixture of experts, whose gate and experts can be told apart; got {name!r}")
    for what, found in (("planner", planner.problem), ("cases", cases.problem), ("training samples", training.problem)):
        if found is not problem and found.fingerprint != problem.fingerprint:
            raise ValueError(
                f"{what} made for {found.id} with fingerprint {found.fingerprint}, expected {problem.id} with "
                f"{problem.fingerprint}; give those of one problem"
            )
    if len(cases) == 0 or neighbours < 1:
        raise ValueError(f"expected at least one case and one neighbour, got {len(cases)} and {neighbours}")


@dataclass(frozen=True, eq=False)
class _Trial:
    """Tracks given plans and evaluates them."""

    problem: OptimalControlProblem
    dt: float
    at: EvaluatedAt

    def episodes(self, p: Array, plan: Trajectory) -> Episodes:
        """Episodes from ``p`` (B, np) in which ``plan`` (B plans) is tracked."""
        envs = environments(self.problem, min(len(p), BATCH), self.dt)
        episodes = rollout(envs, TrackingPolicy(self.problem, StoredPlans(p, plan), self.dt), p)
        envs.close()
        return episodes

    def error(self, episodes: Episodes) -> Array:
        """The error when they are evaluated, (B,)."""
        return episodes.plan_end_error if self.at is EvaluatedAt.PLAN_END else episodes.final_error

    def success(self, episodes: Episodes) -> Bools:
        """Whether they are in the goal ball then, (B,)."""
        if self.at is EvaluatedAt.PLAN_END:
            return np.asarray(self.error(episodes) < self.problem.goal.radius)
        return episodes.success


def _failures(
    planner: NetworkPlanner,
    cases: Samples,
    plan: Trajectory,
    episodes: Episodes,
    training: Samples,
    trial: _Trial,
    neighbours: int,
) -> list[Failure]:
    """A failure for each of ``cases``, on which the ``planner``'s ``plan`` fails in ``episodes``."""
    p = cases.parameters
    chosen, probabilities = planner.gate(p)
    nearest, distance = _nearest(training, cases, neighbours)
    good, right = _good_experts(planner, p, chosen, trial), _right_experts(planner, cases.mode)
    tracked = trial.success(trial.episodes(p, cases.trajectory))
    sufficient = _reachable(training, nearest, p, trial) & right.any(axis=1)
    causes = np.select(
        [~tracked, (good & right).any(axis=1), ~sufficient], [Cause.TRACKER, Cause.GATE, Cause.DATA], Cause.EXPERT
    )
    error, predicted = trial.error(episodes), cases.problem.goal_error(plan.states[:, -1])
    difference = relative_cost_difference(cases.mode_costs)
    return [
        Failure(
            index=int(cases.index[i]),
            parameters=tuple(p[i].tolist()),
            cause=Cause(causes[i]),
            mode=cases.problem.modes.names[cases.mode[i]],
            chosen=int(chosen[i]),
            confidence=float(probabilities[i, chosen[i]]),
            right=tuple(np.flatnonzero(right[i]).tolist()),
            successful=tuple(np.flatnonzero(good[i]).tolist()),
            relative_gap=_number(difference[i]),
            nearest_distance=_number(distance[i]),
            final_error=float(error[i]),
            predicted_error=_number(predicted[i]),
            left_box=bool(episodes.left_box[i]),
            clipped=bool(episodes.clipped[i]),
            rejected=bool(episodes.rejected[i]),
        )
        for i in range(len(p))
    ]


def _good_experts(planner: NetworkPlanner, p: Array, chosen: Ints, trial: _Trial) -> Bools:
    """Experts whose own plans succeed from ``p`` (B, np), where the mixture fails, (B, r)."""
    good = np.stack([trial.success(trial.episodes(p, plan)) for plan in planner.experts(p)], axis=1)
    if isinstance(planner.mixing, Argmax):
        # The chosen expert's plan is the mixture's, but a batch of another size is rounded differently.
        good[np.arange(len(p)), chosen] = False
    return good


def _right_experts(planner: NetworkPlanner, modes: Ints) -> Bools:
    """Experts that are right where ``modes`` (B,) are optimal, (B, r); all where clusters are not families."""
    assert isinstance(planner.network, MixtureOfExperts)
    # Retraining begins with a mixture over clusters and keeps their order.
    made = planner.details.get("pretraining", planner.details)
    clusters = made.get("clusters", {})
    if clusters.get("method") != "custom":
        return np.ones((len(modes), len(planner.network.experts)), bool)
    return np.asarray(modes[:, None] == np.asarray(clusters["settings"]["modes"], dtype=np.int64))


def _nearest(training: Samples, cases: Samples, neighbours: int) -> tuple[Ints, Array]:
    """The nearest training samples of the same solution family, with the distance to the first.

    Rows (B, neighbours) are −1 and distances (B,) are +inf where there are no more.
    """
    rows = np.full((len(cases), neighbours), -1, dtype=np.int64)
    distance = np.full(len(cases), np.inf)
    for mode in np.unique(cases.mode):
        here, members = np.flatnonzero(cases.mode == mode), np.flatnonzero(training.mode == mode)
        if not len(members):
            continue
        stored = Neighbours(cases.problem.parameters, training.parameters[members])
        away, found = stored.nearest(cases.parameters[here], neighbours)
        rows[here, : found.shape[1]] = members[found]
        distance[here] = away[:, 0]
    return rows, distance


def _reachable(training: Samples, rows: Ints, p: Array, trial: _Trial) -> Bools:
    """Whether any of the training samples ``rows`` (B, neighbours) succeeds when it is tracked from ``p``, (B,)."""
    reachable = np.zeros(len(p), bool)
    for column in rows.T:
        there = np.flatnonzero(column >= 0)
        if len(there):
            plan = training.trajectory[column[there]]
            reachable[there] |= trial.success(trial.episodes(p[there], plan))
    return reachable


def _number(value: float) -> float | None:
    """``value``, or ``None`` where it is not finite and JSON could not hold it."""
    return float(value) if np.isfinite(value) else None
