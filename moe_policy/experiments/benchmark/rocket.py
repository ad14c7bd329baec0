"""The benchmark of the rocket."""

from __future__ import annotations

from moe_policy.experiments.benchmark.parts import Benchmark, Planners, Training
from moe_policy.experiments.perturbations import SENSING, disturbance, mismatch
from moe_policy.learning.settings import TrainingSettings

BENCHMARK = Benchmark(
    short="rocket",
    planners=Planners(compared=("snn", "moe-kmeans-4"), trained=("snn", "moe-kmeans-4"), stored=1_000),
    training=Training(settings=TrainingSettings(epochs=600)),
    perturbations=(
        mismatch("gravity", "gravity"),
        mismatch("propellant", "alpha"),
        disturbance("m/s²", "vx", "vz", levels=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0)),
        *SENSING,
    ),
)
