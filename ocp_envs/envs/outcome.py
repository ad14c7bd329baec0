"""What one control step of a vector environment led to, and its ``info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.arrays import Array, Bools

#: Gymnasium's type of ``info`` and of the options of a reset.
Info = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Results (n,) of one control step of n rows, zero for rows that did not move.

    ``reached``: the state is in the goal ball. ``cost``: of the step, with the charge for leaving the operating box.
    ``violation``: of the path constraints at its end, ``None`` without constraints. ``left_box``: the state left it.
    ``controls`` (n, nu) are those that the environment was given, before they are clipped and delayed.
    """

    controls: Array
    reached: Bools
    cost: Array
    violation: Array | None
    left_box: Bools

    def info(self, rows: Bools) -> Info:
        """``info`` of the ``rows`` (n,) in Gymnasium's vector convention: arrays, and masks under ``_key``."""
        if not rows.any():
            return {}
        values: dict[str, Array | Bools] = {"is_success": self.reached, "cost": self.cost}
        if self.violation is not None:
            values["violation"] = self.violation
        info: Info = {}
        for key, value in values.items():
            info[key] = np.where(rows, value, np.zeros((), dtype=value.dtype))
            info[f"_{key}"] = rows.copy()
        failed = self.left_box & rows
        if failed.any():
            info["failure"] = np.full(len(rows), None, dtype=object)
            info["failure"][failed] = "left_box"
            info["_failure"] = failed
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
