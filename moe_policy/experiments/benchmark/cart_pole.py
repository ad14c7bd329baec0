"""The benchmark of the pole on a cart."""

from __future__ import annotations

from moe_policy.experiments.benchmark.parts import Benchmark, Planners, Training
from moe_policy.experiments.perturbations import SENSING, disturbance, mismatch
from moe_policy.learning.settings import TrainingSettings

BENCHMARK = Benchmark(
    short="cart-pole",
    planners=Planners(
        compared=("snn", "moe-custom", "moe-kmeans-10"), trained=("snn", "moe-custom", "moe-kmeans-10"), stored=1_000
    ),
    training=Training(settings=TrainingSettings(epochs=1000)),
    perturbations=(
        mismatch("cart", "cart"),
        mismatch("pole", "pole"),
        mismatch("length", "length"),
        disturbance("m/s²", "v", levels=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0)),
        *SENSING,
    ),
)
