"""The benchmark of the pendulum of any mass."""

from __future__ import annotations

from moe_policy.experiments.benchmark.parts import Benchmark, Planners, Training
from moe_policy.experiments.perturbations import SENSING, disturbance, mismatch
from moe_policy.learning.settings import TrainingSettings

BENCHMARK = Benchmark(
    short="uncertain-pendulum",
    planners=Planners(
        compared=("snn", "moe-custom", "moe-kmeans-10"), trained=("snn", "moe-custom", "moe-kmeans-10"), stored=1_500
    ),
    training=Training(settings=TrainingSettings(epochs=800)),
    # Mass and torque are parameters, known to every planner.
    perturbations=(
        mismatch("length", "length"),
        mismatch("gravity", "gravity"),
        disturbance("rad/s²", "omega", levels=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0)),
        *SENSING,
    ),
)
