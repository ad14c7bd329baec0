"""Short trainings for tests, and the comparison of their weights."""

from __future__ import annotations

import torch

from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.network import NetworkPlanner

QUICK = TrainingSettings(epochs=15)


def weights(planner: NetworkPlanner) -> dict[str, torch.Tensor]:
    return dict(planner.network.state_dict())


def equal(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)
