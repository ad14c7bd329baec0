"""Batches of episodes and their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch


@checked
@dataclass(frozen=True, eq=False)
class Episodes(Batch):
    """Results of B episodes; all arrays are (B,) but for the parameters and the records.

    Args:
        parameters: p of the episodes, (B, np).
        reached: entered the goal ball.
        success: in the goal ball at the evaluation time, whatever the path; see :meth:`clear`.
        cost: ∫L dt up to the first entry; of the whole episode where there is none.
        entry_time: seconds to the first entry, NaN where there is none.
        evaluation_time: seconds to the evaluation, or to leaving the box.
        final_error: ‖x − goal‖ at the evaluation time.
        plan_end_error: the same at the plan's end, before any terminal regulation; NaN for policies without a plan.
        left_box: left the operating box.
        violation: largest violation of the path constraints initially and at the ends of control steps; 0 without
            constraints.
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
    evaluation_time: Array
    final_error: Array
    plan_end_error: Array
    left_box: Bools
    violation: Array
    knot_violation: Array
    clipped: Bools
    rejected: Bools
    states: Array | None = None
    controls: Array | None = None

    def clear(self, tolerance: float = 0.0) -> Bools:
        """Episodes (B,) that violate no path constraint by more than ``tolerance``, in the unit of the constraints.

        ``success`` does not ask for this: an episode that crosses an obstacle on its way to the goal succeeds.
        """
        return np.asarray(self.violation <= tolerance)

    @checked
    def to_frame(self, problem: ProblemOrId) -> Any:
        """The episodes as a ``DataFrame`` of pandas, one a row, with a column for each result and each parameter.

        Parameters have the names that ``problem`` gives them; records of states and controls are left out.

        Raises:
            ImportError: pandas is not installed.
            ValueError: episodes of a problem with another number of parameters.
        """
        problem = problem_of(problem)
        try:
            from pandas import DataFrame
        except ImportError as error:
            raise ImportError(f"to_frame needs pandas: pip install pandas ({error})") from error
        names = problem.parameters.names
        if self.parameters.shape[1] != len(names):
            got = f"episodes with {self.parameters.shape[1]} parameters"
            raise ValueError(f"{problem.id}: expected the parameters {', '.join(names)}, got {got}")
        columns = self._columns().items()
        results = {name: column for name, column in columns if isinstance(column, np.ndarray) and column.ndim == 1}
        return DataFrame(dict(zip(names, self.parameters.T)) | results)

    @classmethod
    def concatenate(cls, parts: Sequence[Episodes]) -> Episodes:
        """The episodes of all ``parts``, in order; records are padded with NaN to the longest."""
        longest = max(0 if part.controls is None else part.controls.shape[1] for part in parts)
        return super().concatenate([part._padded(longest) for part in parts])

    def _padded(self, steps: int) -> Episodes:
        """These episodes with records of ``steps`` control steps."""
        if self.states is None or self.controls is None:
            return self
        missing = steps - self.controls.shape[1]
        states, controls = (
            np.pad(record, ((0, 0), (0, missing), (0, 0)), constant_values=np.nan)
            for record in (self.states, self.controls)
        )
        return replace(self, states=states, controls=controls)
