"""The benchmarks of the problems that are not the paper's."""

from __future__ import annotations

from moe_policy.experiments.benchmark.parts import Benchmark, Planners, Training
from moe_policy.experiments.perturbations import SENSING, Perturbation, disturbance, mismatch
from moe_policy.learning.settings import DEFAULT, TrainingSettings

_LEVELS = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0)


def _benchmark(
    short: str,
    planners: tuple[str, ...],
    epochs: int,
    perturbations: tuple[Perturbation, ...],
    stored: int = 1_000,
    batch: int = 128,
    rate: float = DEFAULT.learning_rate,
) -> Benchmark:
    """The benchmark called ``short`` whose ``planners`` are trained for ``epochs`` with minibatches of ``batch`` and
    the learning ``rate``, and compared.
    """
    return Benchmark(
        short=short,
        planners=Planners(compared=planners, trained=planners, stored=stored),
        training=Training(settings=TrainingSettings(epochs=epochs, batch=batch, gate_batch=batch, learning_rate=rate)),
        perturbations=(*perturbations, *SENSING),
    )


CART_POLE = _benchmark(
    "cart-pole",
    ("snn", "moe-custom", "moe-auto"),
    600,
    (
        mismatch("cart", "cart"),
        mismatch("pole", "pole"),
        mismatch("length", "length"),
        disturbance("m/s²", "v", levels=_LEVELS),
    ),
    rate=5e-3,
)
# Mass and torque are parameters, known to every planner.
UNCERTAIN_PENDULUM = _benchmark(
    "uncertain-pendulum",
    ("snn", "moe-custom", "moe-kmeans-10"),
    200,
    (
        mismatch("length", "length"),
        mismatch("gravity", "gravity"),
        disturbance("rad/s²", "omega", levels=_LEVELS),
    ),
    stored=1_500,
    batch=64,
)
ROCKET = _benchmark(
    "rocket",
    ("snn", "moe-kmeans-4"),
    300,
    (
        mismatch("gravity", "gravity"),
        mismatch("propellant", "alpha"),
        disturbance("m/s²", "vx", "vz", levels=_LEVELS),
    ),
)
TWO_LINK_ARM = _benchmark(
    "arm",
    ("snn", "moe-auto", "moe-kmeans-10"),
    300,
    (
        mismatch("upper arm", "mass_1"),
        mismatch("forearm", "mass_2"),
        disturbance("rad/s²", "w1", "w2", levels=_LEVELS),
    ),
)
PLANAR_QUADCOPTER = _benchmark(
    "discs",
    ("snn", "moe-custom", "moe-kmeans-8"),
    300,
    (
        mismatch("mass", "mass"),
        mismatch("inertia", "inertia"),
        disturbance("m/s²", "vx", "vz", levels=_LEVELS),
    ),
)
QUADCOPTER_RECOVERY = _benchmark(
    "recovery",
    ("snn", "moe-kmeans-4"),
    150,
    (
        mismatch("mass", "mass"),
        mismatch("inertia", "inertia_x", "inertia_y", "inertia_z"),
        disturbance("m/s²", "vx", "vy", "vz", levels=_LEVELS),
    ),
    batch=64,
)
