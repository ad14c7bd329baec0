"""A planner that checks its plans, repairs those that fail, and abstains where nothing helps.

For each instance, the plans of the likeliest experts are tracked in the model, all at once. The cheapest one that
reaches the goal at its end, before any terminal regulation, and keeps all constraints is the plan. Where there is none,
the one nearest to success is repaired by a few iterations of the solver, with a margin on the path constraints that
grows until the tracked path is clear. Where that fails, the instance is solved from the plan of every candidate.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.checking.candidates import Candidates
from moe_policy.checking.forecast import Forecast
from moe_policy.checking.remedies import Repair, repaired, solved
from moe_policy.checking.selection import Selected, select
from moe_policy.checking.verdict import HOW, CheckedPlans, Verdict, reason_of
from moe_policy.control.weights import TrackingWeights
from moe_policy.planners.margin import Margin
from moe_policy.planners.owner import check_owner
from moe_policy.protocols import Planner
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problems import ProblemOrId
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: Episodes that are predicted at once: the gains along many plans need much memory.
_ROWS = 1000


class BestOf:
    """The best of several plans by what the model predicts of them: no solver, and no verdict.

    It is the cheapest plan whose episode ends at the goal, before any terminal regulation, and keeps all constraints;
    where there is none, the plan that is nearest to this.

    Args:
        candidates: the plans for each instance.
        dt: control period of the environment, seconds.
        weights: tracking weights of the policy; by default those of the problem.
        name: short name for tables; by default that of the planner with the number of plans.
    """

    @checked
    def __init__(
        self,
        candidates: Candidates,
        *,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
        name: str | None = None,
    ) -> None:
        self.candidates, self.problem = candidates, candidates.problem
        self._forecast = Forecast(self.problem, dt, weights)
        self.name = name or f"{getattr(candidates.planner, 'name', 'planner')}, best of {candidates.count}"

    def __repr__(self) -> str:
        return f"BestOf({self.candidates!r})"

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn."""
        within, turns = self.problem.in_one_turn(p)
        parts = [self._best(within[rows]) for rows in blocks(len(within), self.candidates.count)]
        return Trajectory.concatenate(parts).shifted(turns)

    def _best(self, p: Array) -> Trajectory:
        sources, plans = self.candidates(p)
        return select(self._forecast, p, plans, HOW.index("chosen"), sources).plan


def blocks(size: int, count: int) -> list[slice]:
    """Slices that cover ``size`` instances with ``count`` plans each, at least one; few enough plans in each."""
    step = max(1, _ROWS // count)
    return [slice(begin, begin + step) for begin in range(0, max(size, 1), step)]


class Checked:
    """Plans that are verified in the model, or none.

    Verified means: tracked by :class:`~moe_policy.control.tracking.TrackingPolicy` with the same ``dt`` and ``weights``
    on a plant that is the model, the plan reaches the goal at its end, before any terminal regulation, which then keeps
    the state there; and the operating box and the path constraints are kept at all control steps and knots. Where no
    plan can be verified, the plan is NaN: the planner abstains. :meth:`check` says how each plan was made and what is
    predicted of it.

    Args:
        planner: where plans come from; of a mixture, several experts are tried.
        experts: number of experts that are tried.
        margins: each is tried with these margins, too.
        repair: how plans are repaired; ``None`` for the default.
        nearest: a planner whose plan is one more guess of the solver, such as the nearest stored solution.
        dt: control period of the environment, seconds.
        weights: tracking weights of the policy; by default those of the problem.
        constants: physical constants of the plant by name, in SI units, where they differ from those of the problem.
            Plans are then verified on that plant and repaired for it; the policy that tracks them keeps the problem's.
        abstain: whether plans that are not verified are NaN; otherwise they are the ones nearest to success.
        problem: what is planned for; by default the ``problem`` of the planner.
        name: short name for tables; by default that of the planner.

    Raises:
        TypeError: a planner that cannot be called, or numbers that are none.
        ValueError: a planner without a ``problem`` where none is given, one of another problem, a constant that the
            problem does not have, or an argument out of its range.
    """

    @checked
    def __init__(
        self,
        planner: Planner,
        *,
        experts: int = 2,
        margins: Sequence[Margin] = (),
        repair: Repair | None = None,
        nearest: Planner | None = None,
        dt: float = 0.02,
        weights: TrackingWeights | None = None,
        constants: Mapping[str, float] | None = None,
        abstain: bool = True,
        problem: ProblemOrId | None = None,
        name: str | None = None,
    ) -> None:
        self.candidates = Candidates(planner, experts, margins, problem=problem)
        self.problem, self.planner, self.abstain = self.candidates.problem, planner, abstain
        self.repair = Repair() if repair is None else repair
        check_owner(self.problem, getattr(nearest, "problem", None), "nearest")
        self.nearest = nearest
        self.model = self.problem.with_constants(**(constants or {}))
        self._forecast = Forecast(self.problem, dt, weights, self.model)
        self.dt = self._forecast.dt
        self.name = name or f"{getattr(planner, 'name', 'planner')}, checked"

    def __repr__(self) -> str:
        return f"Checked({self.planner!r}, {self.candidates.count} candidates, {self.repair}, dt={self.dt:g})"

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn; NaN where the planner abstains."""
        return self.check(p).trajectory

    def check(self, p: ArrayLike) -> CheckedPlans:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn, with a verdict on each."""
        within, turns = self.problem.in_one_turn(p)
        parts = [self._checked(within[rows]) for rows in blocks(len(within), self.candidates.count)]
        plans = Trajectory.concatenate([part.trajectory for part in parts]).shifted(turns)
        return CheckedPlans(plans, tuple(verdict for part in parts for verdict in part.verdicts))

    def _checked(self, p: Array) -> CheckedPlans:
        """Plans of one block of parameters ``p`` (B, np), their angles in the turn around the centre of the box."""
        watch, hopeless = _Watch(len(p)), infeasible_rows(self.model, p)
        sources, plans = self.candidates(p)
        best = select(self._forecast, p, plans, HOW.index("chosen"), sources)
        watch.spent_on(np.arange(len(p)))
        margin = np.full(len(p), self.repair.margin)

        def failing() -> Ints:
            rows = np.flatnonzero(~best.predicted.success)
            return rows[[row not in hopeless for row in rows.tolist()]] if len(hopeless) else rows

        if len(rows := failing()):
            new, margin[rows] = repaired(self._forecast, self.model, p[rows], best[rows], self.repair)
            best = best.replaced_at(rows, new)
            watch.spent_on(rows)
        if len(rows := failing()):
            guesses = [plan[rows] for plan in plans]
            if self.nearest is not None:
                guesses.append(self.nearest(p[rows]))
            new = solved(self._forecast, self.model, p[rows], guesses, margin[rows], best[rows])
            best = best.replaced_at(rows, new)
            watch.spent_on(rows)
        return self._judged(best, hopeless, watch.milliseconds)

    def _judged(self, best: Selected, hopeless: Mapping[int, str], milliseconds: Array) -> CheckedPlans:
        """The plans of ``best``, and verdicts on them."""
        predicted, trajectory = best.predicted, best.plan
        verified = predicted.success
        if self.abstain and not verified.all():
            nothing = self.problem.unflatten(np.full((int((~verified).sum()), self.problem.flat_size), np.nan))
            trajectory = trajectory.replaced(~verified, nothing)
        names = [getattr(source, "name", "planner") for source in self.candidates.sources]
        verdicts = tuple(
            Verdict(
                how=HOW[best.how[i]] if good or not self.abstain else "abstained",
                source=names[best.source[i]],
                verified=bool(good),
                cost=float(predicted.cost[i]),
                clearance=float(predicted.clearance[i]),
                final_error=float(predicted.final_error[i]),
                milliseconds=float(milliseconds[i]),
                reason="" if good else hopeless.get(i) or reason_of(self.problem, predicted[i]),
            )
            for i, good in enumerate(verified.tolist())
        )
        return CheckedPlans(trajectory, verdicts)


class _Watch:
    """How many ``milliseconds`` (B,) each of B instances took: of every step its part."""

    def __init__(self, size: int) -> None:
        self.milliseconds, self._last = np.zeros(size), time.perf_counter()

    def spent_on(self, rows: Ints) -> None:
        """The time since the last call, or the beginning, was spent on ``rows``."""
        now = time.perf_counter()
        self.milliseconds[rows] += 1e3 * (now - self._last) / max(len(rows), 1)
        self._last = now
