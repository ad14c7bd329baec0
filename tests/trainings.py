"""Short trainings for tests, and the comparison of their weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.network import NetworkPlanner

QUICK = TrainingSettings(epochs=15)


def weights(planner: NetworkPlanner) -> dict[str, NDArray[np.float32]]:
    return planner.network.tensors()


def equal(a: dict[str, NDArray[np.float32]], b: dict[str, NDArray[np.float32]]) -> bool:
    return a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a)
