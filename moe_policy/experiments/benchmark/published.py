"""The paper's values: Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019).

Tables I (ways to train on the pendulum) and II (all problems), by the name of the planner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from moe_policy.learning.architectures import Hidden


@dataclass(frozen=True, kw_only=True)
class Published:
    """The paper's values of a planner, ``None`` where it gives none."""

    validation_error: float | None = None  # smooth L1 loss in the units of the trajectory, on the validation set
    success: int | None = None  # number of successful rollouts
    violation: float | None = None  # mean violation of the path constraint at the knots, metres
    test_error: float | None = None  # loss of a single network on the test split
    cluster_sizes: tuple[int, int] | None = None  # minimum and maximum number of samples in a cluster of a mixture
    gate_accuracy: float | None = None  # of a mixture, on the test split
    #: loss on the test split, mean and standard deviation over the experts
    expert_test_error: tuple[float, float] | None = None


PENDULUM: Mapping[str, Published] = MappingProxyType(
    {
        "snn": Published(validation_error=0.046, success=717, test_error=0.058),
        "moe-custom": Published(
            validation_error=0.030,
            success=998,
            cluster_sizes=(388, 505),
            gate_accuracy=0.972,
            expert_test_error=(0.0032, 0.0031),
        ),
        "moe-random": Published(validation_error=0.035, success=829),
        "moe-kmeans-3": Published(validation_error=0.039, success=970),
        "moe-kmeans-4": Published(validation_error=0.029, success=1000),
        "moe-kmeans-10": Published(validation_error=0.051, success=1000),
        "moe-retrained-argmax": Published(validation_error=0.027, success=941),
        "moe-retrained-softmax-1": Published(validation_error=0.028, success=896),
        "moe-retrained-softmax-0.1": Published(validation_error=0.026, success=969),
    }
)
#: Test error of single networks of the pendulum by their hidden layers.
PENDULUM_DEPTHS: Mapping[Hidden, float] = MappingProxyType(
    {(300,): 0.058, (50, 20): 0.258, (20, 50): 0.170, (30, 30, 30): 0.232}
)
VEHICLE: Mapping[str, Published] = MappingProxyType(
    {
        "snn": Published(validation_error=0.046, success=6729, test_error=0.045),
        "moe-custom": Published(
            validation_error=0.019,
            success=9975,
            cluster_sizes=(7266, 45626),
            gate_accuracy=0.987,
            expert_test_error=(0.0018, 0.0014),
        ),
        "moe-kmeans-6": Published(
            validation_error=0.031,
            success=9413,
            cluster_sizes=(7228, 28913),
            gate_accuracy=0.977,
            expert_test_error=(0.0088, 0.0082),
        ),
    }
)
QUADCOPTER: Mapping[str, Published] = MappingProxyType(
    {
        "snn": Published(validation_error=4.7e-5, success=1000, test_error=8.6e-5),
        "moe-kmeans-4": Published(
            validation_error=4.6e-5,
            success=1000,
            cluster_sizes=(2072, 2356),
            gate_accuracy=0.996,
            expert_test_error=(4.6e-5, 9e-6),
        ),
    }
)
#: Where every plan ends at the goal success has no meaning; the paper gives how far rollouts enter the sphere.
QUADCOPTER_OBSTACLE: Mapping[str, Published] = MappingProxyType(
    {
        "snn": Published(validation_error=0.024, violation=0.315, test_error=0.014),
        "moe-custom": Published(
            validation_error=0.015,
            violation=0.043,
            cluster_sizes=(70474, 84280),
            gate_accuracy=0.889,
            expert_test_error=(0.0022, 0.0003),
        ),
        "moe-kmeans-8": Published(
            validation_error=0.016,
            violation=0.167,
            cluster_sizes=(64682, 101669),
            gate_accuracy=0.964,
            expert_test_error=(0.0052, 0.0027),
        ),
        "moe-kmeans-20": Published(violation=0.056),
    }
)
