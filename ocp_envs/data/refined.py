"""What a refinement changes: the better of two trajectories of each solution family, and by how much costs fall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ocp_envs.data.database import Database
from ocp_envs.data.layout import COUNTS, StoredRows
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked

#: A cost that is lower by this fraction is an improvement; less may be the solver's tolerance.
IMPROVEMENT = 1e-3


@checked
@dataclass(frozen=True, eq=False)
class Refinement:
    """A refined ``database``, and the costs of its M instances ``before`` and ``after``, (M, modes); +inf for none."""

    database: Database
    before: Array
    after: Array

    def __repr__(self) -> str:
        return (
            f"<Refinement of {len(self.before)} instances: {self.improved.sum()} cheaper by more than "
            f"{100 * IMPROVEMENT:g} %, {self.new.sum()} solved for the first time, mean cost "
            f"{self.mean_costs[0]:.6g} → {self.mean_costs[1]:.6g} ({100 * self.change:+.2f} %)>"
        )

    @property
    def improvements(self) -> Array:
        """By what fraction the best cost of each instance fell, (M,); NaN where it was not solved before."""
        before, after = self.before.min(axis=1), self.after.min(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(np.isfinite(before), (before - after) / np.abs(before), np.nan))

    @property
    def improved(self) -> Bools:
        """Which instances have become cheaper by more than 0.1 %, (M,)."""
        return np.asarray(self.improvements > IMPROVEMENT)

    @property
    def new(self) -> Bools:
        """Which instances are solved for the first time, (M,)."""
        return np.asarray(np.isfinite(self.after).any(axis=1) & ~np.isfinite(self.before).any(axis=1))

    @property
    def new_families(self) -> int:
        """In how many instances how many solution families were found for the first time, all together."""
        return int((np.isfinite(self.after) & ~np.isfinite(self.before)).sum())

    @property
    def mean_costs(self) -> tuple[float, float]:
        """Mean best cost before and after, over the instances that were solved before; NaN without any."""
        known = np.isfinite(self.before).any(axis=1)
        if not known.any():
            return np.nan, np.nan
        return float(self.before[known].min(axis=1).mean()), float(self.after[known].min(axis=1).mean())

    @property
    def change(self) -> float:
        """Relative change of the mean cost; negative where it fell."""
        before, after = self.mean_costs
        return (after - before) / abs(before)


def cheaper(before: Array, after: Array) -> Bools:
    """Where the costs ``after`` are lower than those ``before`` by more than :data:`IMPROVEMENT`, of any shape."""
    with np.errstate(invalid="ignore"):
        return np.asarray(after < before - IMPROVEMENT * np.abs(before))


def better(stored: StoredRows, found: StoredRows) -> StoredRows:
    """Of B instances the cheaper trajectory of every solution family, from ``stored`` or ``found``."""
    wins = found.cost < stored.cost
    cost, slot = np.where(wins, found.cost, stored.cost), np.where(wins, found.slot_status, stored.slot_status)
    sums = {name: getattr(stored, name) + getattr(found, name) for name in COUNTS}
    return replace(
        stored,
        status=np.where(np.isfinite(cost).any(axis=1), np.int8(Status.SOLVED), stored.status),
        slot_status=slot,
        cost=cost,
        z=np.where(wins[..., None], found.z, stored.z),
        multipliers=np.where(wins[..., None, None], found.multipliers, stored.multipliers),
        **sums,
    )
