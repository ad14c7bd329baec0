"""What a rollout returns: a batch of episodes and what became of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.arrays import Array, Bools


@dataclass(frozen=True, eq=False)
class Episodes:
    """What became of B episodes; all arrays are (B,) but for the parameters and the records.

    Args:
        parameters: p of the episodes, (B, np).
        reached: entered the goal ball.
        success: in the goal ball at the judging time.
        cost: ∫L dt up to the first entry; of the whole episode where there is none.
        entry_time: seconds to the first entry, NaN where there is none.
        judging_time: seconds to the judgement.
        final_error: ‖x − goal‖ at the judgement, or where the episode left the box.
        plan_end_error: the same at the plan's end, before any hold; NaN for policies without a plan.
        left_box: left the operating box.
        violation: largest violation of the path constraints at the start and the ends of ticks; 0 without constraints.
        knot_violation: the same at the plan's knots t_i = i·t_f/(N-1); NaN for policies without a plan.
        clipped: the plan's duration was clipped to its bounds; False for policies without a plan.
        rejected: the plan was not finite; False for policies without a plan.
        states: (B, T+1, nx) if recorded, NaN after the end of an episode.
        controls: (B, T, nu) if recorded, the same.
    """

    parameters: Array
    reached: Bools
    success: Bools
    cost: Array
    entry_time: Array
    judging_time: Array
    final_error: Array
    plan_end_error: Array
    left_box: Bools
    violation: Array
    knot_violation: Array
    clipped: Bools
    rejected: Bools
    states: Array | None = None
    controls: Array | None = None

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, index: slice | NDArray[Any]) -> Episodes:
        """The episodes at ``index``: a slice, a mask or an integer array."""
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        kept: dict[str, Any] = {name: None if v is None else v[index] for name, v in columns.items()}
        return Episodes(**kept)

    @classmethod
    def concatenate(cls, parts: list[Episodes]) -> Episodes:
        """The episodes of all ``parts``, in order; records are padded with NaN to the longest."""
        columns: dict[str, list[Any]] = {
            f.name: [getattr(part, f.name) for part in parts] for f in dataclasses.fields(cls)
        }
        for name in ("states", "controls"):
            if columns[name][0] is not None:
                columns[name] = _padded(columns[name])
        joined: dict[str, Any] = {name: None if v[0] is None else np.concatenate(v) for name, v in columns.items()}
        return cls(**joined)


def _padded(records: list[Array]) -> list[Array]:
    """Arrays (B, T, n) with NaN appended along axis 1 up to the largest T."""
    longest = max(record.shape[1] for record in records)
    return [np.pad(r, ((0, 0), (0, longest - r.shape[1]), (0, 0)), constant_values=np.nan) for r in records]
