"""How far predicted trajectories are from optimal ones: mean smooth-L1 errors (β = 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.scaling import Array
from moe_policy.protocols import Planner
from ocp_envs.trajectory import Trajectory


def standardised_error(planner: NetworkPlanner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error of standardised outputs, the paper's "test error".

    Args:
        planner: the network; its output scaler standardises.
        parameters: (B, np).
        trajectories: the B optimal trajectories.

    Raises:
        ValueError: another number of trajectories than of parameters.
    """
    scale = planner.outputs.scale
    return _smooth_l1(scale(planner(parameters).flat()), scale(trajectories.flat()))


def validation_error(planner: Planner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error of raw outputs in mixed units, the paper's "validation error"; NaN where a plan failed.

    Args:
        planner: any planner.
        parameters: (B, np).
        trajectories: the B optimal trajectories.

    Raises:
        ValueError: another number of trajectories than of parameters.
    """
    p = np.array(parameters, dtype=np.float64, ndmin=2)
    return _smooth_l1(planner(p).flat(), trajectories.flat())


def _smooth_l1(predicted: Array, optimal: Array) -> float:
    if predicted.shape != optimal.shape:
        raise ValueError(f"expected as many trajectories as plans, got {optimal.shape} for {predicted.shape}")
    distance = np.abs(predicted - optimal)
    return float(np.where(distance < 1, distance**2 / 2, distance - 0.5).mean())
