"""How far predicted trajectories are from optimal ones: mean smooth-L1 errors (β = 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.owner import plans_of
from moe_policy.protocols import Planner
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


@checked
def standardised_error(planner: NetworkPlanner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error of the standardised outputs of ``planner`` for ``parameters`` (B, np) against the B optimal
    ``trajectories``: the paper's "test error".
    """
    scale = planner.outputs.scale
    return _smooth_l1(scale(planner(parameters).flat()), scale(trajectories.flat()))


@checked
def validation_error(planner: Planner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error of the raw outputs of ``planner``, in mixed units, for ``parameters`` (B, np) against the B
    optimal ``trajectories``: the paper's "validation error"; NaN where a plan failed.
    """
    return _smooth_l1(plans_of(planner, np.array(parameters, dtype=np.float64, ndmin=2)).flat(), trajectories.flat())


def _smooth_l1(predicted: Array, optimal: Array) -> float:
    if predicted.shape != optimal.shape:
        raise ValueError(f"expected as many trajectories as plans, got {optimal.shape} for {predicted.shape}")
    distance = np.abs(predicted - optimal)
    return float(np.where(distance < 1, distance**2 / 2, distance - 0.5).mean())
