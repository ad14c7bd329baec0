"""What one control step of a vector environment led to, and its ``info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.rows import Batch

#: Gymnasium's type of ``info`` and of the options of a reset.
Info = dict[str, Any]

#: ``info["failure"]`` of a control step that left the operating box; it is empty in all others.
LEFT_BOX = "left_box"


@dataclass(frozen=True, eq=False)
class Outcome(Batch):
    """Results (n,) of one control step of n rows, zero for rows that did not move, or of the beginning of episodes.

    ``parameters``: p of the episodes, (n, np). ``reached``: the state is in the goal ball. ``cost``: of the step, with
    the charge for leaving the operating box. ``left_box``: the state left it. ``violation``: of the path constraints at
    the end of the step, ``None`` without constraints. ``invalid``: the action was NaN.
    """

    parameters: Array
    reached: Bools
    cost: Array
    left_box: Bools
    violation: Array | None
    invalid: Bools

    def __post_init__(self) -> None:
        """Nothing is checked: there is one in every control step."""

    @classmethod
    def none(cls, size: int, parameters: int, constrained: bool) -> Outcome:
        """That of ``size`` rows with ``parameters`` components of p that did not move; ``constrained`` by a path."""
        flags, numbers = np.zeros(size, dtype=np.bool_), np.zeros(size)
        return cls(np.zeros((size, parameters)), flags, numbers, flags, numbers if constrained else None, flags)

    def info(self, rows: Bools) -> Info:
        """``info`` of the ``rows`` (n,) in Gymnasium's vector convention: arrays, and masks under ``_key``."""
        if not rows.any():
            return {}
        values: dict[str, NDArray[Any]] = {"parameters": self.parameters, "is_success": self.reached}
        failure = np.full(len(rows), "", dtype=object)
        failure[self.left_box] = LEFT_BOX
        values |= {"cost": self.cost, "failure": failure}
        if self.violation is not None:
            values["violation"] = self.violation
        info: Info = {}
        others = np.flatnonzero(~rows)
        for key, value in values.items():
            info[key] = value.copy()
            if len(others):
                info[key][others] = None if value.dtype == object else 0
            info[f"_{key}"] = rows.copy()
        if (invalid := self.invalid & rows).any():
            info["invalid_action"], info["_invalid_action"] = invalid, invalid.copy()
        return info

    def final_info(self, ended: Bools, observed: NDArray[np.float32]) -> Info:
        """What ``info`` keeps of episodes that ``ended`` (n,) in a step whose rows begin another one in the same step.

        ``observed`` are the last observations, (n, nx + nc).
        """
        final = np.full(len(ended), None, dtype=object)
        for row in np.flatnonzero(ended):
            final[row] = observed[row].copy()
        info = self.info(ended)
        return {"final_obs": final, "_final_obs": ended, "final_info": info, "_final_info": ended.copy()}
