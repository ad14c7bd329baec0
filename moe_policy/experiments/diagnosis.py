"""Why a mixture of experts fails: one cause for every start whose tracked plan misses the goal.

For a failing start, other plans of the same start are tracked in the same way, and the first line that holds names the
cause. The *right* expert is that of the optimal trajectory's mode where the clusters are the problem's modes; for any
other clusters (k-means) nobody knows which it is, and every expert counts as right.

    tracker    the optimal trajectory fails when it is tracked
    gate       a right expert's plan succeeds: the gate chose another one, or blended it with others
    data       there is nothing near to learn from: the nearest training samples of the optimal mode all fail when they
               are tracked from here, or the mode has no sample or no expert at all
    expert     the rest: nearby samples would do, the right expert did not learn to do as well

The order matters. Nobody can be blamed for a start where the optimum itself is lost. The gate comes before expert and
data, because the plan of the right expert was there. And a nearest sample that succeeds shows that the data were good
enough, while one that fails does not prove that an expert could not have interpolated: ``data`` is an upper bound, and
so is ``gate`` for clusters that are not modes, where some expert may succeed by luck. Two figures tell more about a
failure: near a jump between modes the relative gap between the best and the second mode's cost is small, and the
distance to the nearest training sample of the mode is measured as the nearest-neighbour planner does, every coordinate
of p divided by the width of its box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import Argmax, MixtureOfExperts
from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.samples import Samples
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.trajectory import Trajectory


class Cause(StrEnum):
    """Who is to blame; see the module."""

    TRACKER = "tracker"
    GATE = "gate"
    DATA = "data"
    EXPERT = "expert"


class Judgement(StrEnum):
    """When a plan is judged: at the judging time of the rollout, or at the plan's end, before any hold."""

    JUDGING_TIME = "judging-time"
    PLAN_END = "plan-end"


@dataclass(frozen=True)
class Failure:
    """One start whose tracked plan misses the goal.

    Args:
        index: number of the case in its database.
        parameters: p, np numbers.
        cause: see the module.
        mode: name of the optimal trajectory's mode.
        chosen: the expert the gate prefers.
        confidence: the gate's probability of it.
        right: the experts that count as right: that of the optimal mode, or none if it has none; all of them where the
            clusters are not the problem's modes.
        successful: the experts whose plans of this start succeed on their own.
        relative_gap: (second − best) / |best| over the costs of the modes; ``None`` where one mode alone was found.
        nearest_distance: from p to the nearest training sample of the optimal mode; ``None`` where there is none.
        final_error: ‖state error‖ when the plan was judged, or where the episode left the box.
        predicted_error: the same at the last knot of the plan itself; ``None`` where the plan is not finite.
        left_box: the episode left the operating box.
        clipped: the plan's duration was clipped to its bounds.
        rejected: the plan was not finite.
    """

    index: int
    parameters: tuple[float, ...]
    cause: Cause
    mode: str
    chosen: int
    confidence: float
    right: tuple[int, ...]
    successful: tuple[int, ...]
    relative_gap: float | None
    nearest_distance: float | None
    final_error: float
    predicted_error: float | None
    left_box: bool
    clipped: bool
    rejected: bool

    def record(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self) | {"cause": str(self.cause)}


def counts(failures: Sequence[Failure]) -> dict[str, int]:
    """How many failures have each cause, the causes without any among them."""
    return {str(cause): sum(failure.cause is cause for failure in failures) for cause in Cause}


def explain(
    problem: OptimalControlProblem,
    planner: NetworkPlanner,
    cases: Samples,
    training: Samples,
    dt: float = 0.02,
    *,
    at: Judgement | str = Judgement.JUDGING_TIME,
    neighbours: int = 3,
) -> list[Failure]:
    """Every case that ``planner`` fails, with its cause.

    Args:
        problem: the problem.
        planner: a mixture of experts.
        cases: solved starts, such as the validation set; at least one.
        training: the solved problems that the mixture learnt from.
        dt: control period, seconds.
        at: when the tracked plans are judged, the mixture's and all others alike.
        neighbours: how many of the nearest training samples are tried before the data are blamed.

    Raises:
        TypeError: a planner without gate and experts.
        ValueError: no cases, no neighbours, an unknown judgement, or parts made for different problems.
    """
    _check(problem, planner, cases, training, neighbours)
    trial = _Trial(problem, dt, Judgement(at))
    plan = planner(cases.parameters)
    episodes = trial.episodes(cases.parameters, plan)
    failed = np.flatnonzero(~trial.success(episodes))
    if not len(failed):
        return []
    cases, episodes, plan = cases[failed], episodes[failed], plan[failed]
    chosen, probabilities = planner.gate(cases.parameters)
    good = _good_experts(planner, cases.parameters, chosen, trial)
    right = _right_experts(planner, cases.mode)
    nearest, distance = _nearest(training, cases, neighbours)
    reachable = _reachable(training, nearest, cases.parameters, trial)
    tracked = trial.success(trial.episodes(cases.parameters, cases.trajectory))
    causes = np.select(
        [~tracked, (good & right).any(axis=1), ~(reachable & right.any(axis=1))],
        [Cause.TRACKER, Cause.GATE, Cause.DATA],
        Cause.EXPERT,
    )
    gap, predicted = relative_cost_difference(cases.mode_costs), problem.goal_error(plan.states[:, -1])
    return [
        Failure(
            index=int(cases.index[i]),
            parameters=tuple(cases.parameters[i].tolist()),
            cause=Cause(causes[i]),
            mode=problem.modes.names[cases.mode[i]],
            chosen=int(chosen[i]),
            confidence=float(probabilities[i, chosen[i]]),
            right=tuple(np.flatnonzero(right[i]).tolist()),
            successful=tuple(np.flatnonzero(good[i]).tolist()),
            relative_gap=_number(gap[i]),
            nearest_distance=_number(distance[i]),
            final_error=float(trial.error(episodes)[i]),
            predicted_error=_number(predicted[i]),
            left_box=bool(episodes.left_box[i]),
            clipped=bool(episodes.clipped[i]),
            rejected=bool(episodes.rejected[i]),
        )
        for i in range(len(failed))
    ]


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
    """Tracks given plans and judges them."""

    problem: OptimalControlProblem
    dt: float
    at: Judgement

    def episodes(self, p: Array, plan: Trajectory) -> Episodes:
        """Episodes from ``p`` (B, np) in which ``plan`` (B plans) is tracked."""
        envs = VectorEnv(self.problem, len(p), autoreset_mode="Disabled", terminate_at_goal=False, dt=self.dt)
        episodes = rollout(envs, TrackingPolicy(self.problem, lambda _: plan, self.dt), p)
        envs.close()
        return episodes

    def error(self, episodes: Episodes) -> Array:
        """The error when they are judged, (B,)."""
        return episodes.plan_end_error if self.at is Judgement.PLAN_END else episodes.final_error

    def success(self, episodes: Episodes) -> Bools:
        """Whether they are in the goal ball then, (B,)."""
        if self.at is Judgement.PLAN_END:
            return np.asarray(self.error(episodes) < self.problem.goal.radius)
        return episodes.success


def _good_experts(planner: NetworkPlanner, p: Array, chosen: NDArray[np.int64], trial: _Trial) -> Bools:
    """Whose plan, followed alone, succeeds from ``p``, where the mixture fails; (B, r)."""
    good = np.stack([trial.success(trial.episodes(p, plan)) for plan in planner.experts(p)], axis=1)
    if isinstance(planner.mixing, Argmax):
        # The chosen expert's plan was the mixture's, but a batch of another size rounds differently.
        good[np.arange(len(p)), chosen] = False
    return good


def _right_experts(planner: NetworkPlanner, modes: NDArray[np.int64]) -> Bools:
    """Which experts are right where ``modes`` (B,) are optimal, (B, r); all where clusters are not modes."""
    assert isinstance(planner.network, MixtureOfExperts)
    # Retraining starts from a mixture over clusters, and keeps their order.
    made = planner.details.get("pretraining", planner.details)
    clusters = made.get("clusters", {})
    if clusters.get("method") != "custom":
        return np.ones((len(modes), len(planner.network.experts)), bool)
    return np.asarray(modes[:, None] == np.asarray(clusters["settings"]["modes"], dtype=np.int64))


def _nearest(training: Samples, cases: Samples, neighbours: int) -> tuple[NDArray[np.int64], Array]:
    """The nearest training samples of the same mode.

    Returns:
        their rows, nearest first, −1 where there are no more, (B, neighbours), and the distance to the first of them,
        +inf where there is none, (B,).
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


def _reachable(training: Samples, rows: NDArray[np.int64], p: Array, trial: _Trial) -> Bools:
    """Whether any of the training samples ``rows`` (B, neighbours) succeeds when it is tracked from ``p``, (B,)."""
    reachable = np.zeros(len(p), bool)
    for column in rows.T:
        there = np.flatnonzero(column >= 0)
        if len(there):
            plan = training.trajectory[column[there]]
            reachable[there] |= trial.success(trial.episodes(p[there], plan))
    return reachable


def _number(value: np.floating[Any]) -> float | None:
    """``value``, or ``None`` where it is not finite and JSON could not hold it."""
    return float(value) if np.isfinite(value) else None
