"""The benchmark of the pendulum."""

from __future__ import annotations

from moe_policy.experiments.benchmark import published
from moe_policy.experiments.benchmark.parts import Benchmark, Clusters, Learners, Overview, Planners, Quick, Training
from moe_policy.experiments.perturbations import SENSING, disturbance, mismatch
from moe_policy.learning.settings import DEFAULT
from moe_policy.rl.settings import SHORT_SAC, PPOSettings, SACSettings

#: Without a price for the distance to the goal PPO learns to stand still: acting costs, and chance does not find the
#: goal. The exploration noise stays, and the discount is that of SAC.
_PPO = PPOSettings(
    steps=3_000_000,
    n_envs=256,
    n_steps=32,
    batch_size=2048,
    n_epochs=8,
    learning_rate=1e-3,
    entropy=0.003,
    reward_scale=0.1,
    shaping=2.0,
    near_starts=0.7,
    evaluate_every=200_000,
)

BENCHMARK = Benchmark(
    short="pendulum",
    planners=Planners(
        compared=("snn", "moe-custom", "moe-kmeans-4"),
        trained=(
            "snn",
            "moe-custom",
            "moe-random",
            "moe-kmeans-3",
            "moe-kmeans-4",
            "moe-kmeans-10",
            "moe-retrained-argmax",
            "moe-retrained-softmax-1",
            "moe-retrained-softmax-0.1",
            "moe-kmeans-pca-4",
        ),
    ),
    training=Training(
        sizes={size: DEFAULT.epochs for size in (80, 160, 320, 640)},
        sized=("snn", "moe-custom", "moe-kmeans-4"),
        paper=("snn", "moe-custom"),
        depths=published.PENDULUM_DEPTHS,
    ),
    clusters=Clusters(numbers=(2, 3, 4, 6, 10), used=4, instances=1_281, settings=DEFAULT),
    learners=Learners(
        settings={"sac": SACSettings(), "ppo": _PPO},
        short={"sac": SHORT_SAC},
        unattempted={
            "tqc over seeds": "one trial, stopped early (results/search_tqc_PendulumSwingup-v0.json): it learns from "
            "fewer decisions than SAC, each of which takes it several times as long; SAC solves the task with every "
            "seed",
            "ppo, up to 20 million decisions": "where it learns to swing up, success is complete well before the end",
        },
    ),
    overview=Overview(learner="sac", kmeans="moe-kmeans-4"),
    published=published.PENDULUM,
    perturbations=(
        mismatch("mass", "mass"),
        mismatch("inertia", "length", divided=("mass",)),
        mismatch("torque", "torque_gain"),
        disturbance("rad/s²", "omega", levels=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0)),
        *SENSING,
    ),
    quick=Quick(training=1281, validation=1000),
)
