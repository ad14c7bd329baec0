"""The benchmark of the ground vehicle."""

from __future__ import annotations

from moe_policy.experiments.benchmark import published
from moe_policy.experiments.benchmark.parts import Benchmark, Clusters, Learners, Overview, Planners, Quick, Training
from moe_policy.experiments.perturbations import SENSING, disturbance, mismatch
from moe_policy.learning.settings import TrainingSettings
from moe_policy.rl.settings import PPOSettings, SACSettings

#: Most episodes begin near the goal: chance seldom parks the vehicle from an initial state in the whole box.
_NEAR_STARTS = 0.7
#: A potential of the distance teaches PPO within millions of decisions. With the fewer that SAC can afford it makes the
#: vehicle wait; a price on the distance drives it to the goal.
_SAC = SACSettings(
    steps=300_000,
    gamma=0.98,
    reward_scale=0.002,
    distance_price=100.0,
    evaluate_every=20_000,
    near_starts=_NEAR_STARTS,
    hidden=(128, 128),
)
_PPO = PPOSettings(
    steps=10_000_000,
    n_envs=256,
    n_steps=32,
    batch_size=2048,
    n_epochs=8,
    learning_rate=1e-3,
    log_std=-1.0,
    gamma=0.99,
    reward_scale=0.05,
    shaping=5.0,
    evaluate_every=1_000_000,
    near_starts=_NEAR_STARTS,
    hidden=(128, 128),
)

BENCHMARK = Benchmark(
    short="vehicle",
    planners=Planners(
        compared=("snn", "moe-custom", "moe-kmeans-10"),
        trained=("snn", "moe-custom", "moe-kmeans-6", "moe-kmeans-10", "moe-kmeans-20"),
        stored=5_000,
    ),
    training=Training(
        settings=TrainingSettings(epochs=100, learning_rate=3e-3),
        sizes={3_000: 640, 10_000: 350, 30_000: 200},
        sized=("snn", "moe-custom", "moe-kmeans-10"),
        over_seeds=(20_000, 100),
    ),
    clusters=Clusters(
        numbers=(4, 6, 8, 10, 14, 20),
        used=10,
        instances=20_000,
        settings=TrainingSettings(epochs=40, learning_rate=3e-3),
    ),
    learners=Learners(
        settings={"sac": _SAC, "ppo": _PPO},
        unattempted={
            "tqc over seeds": "one trial (results/search_tqc_GroundVehicle-v0.json): from as many decisions it learns "
            "more than SAC with the same settings, each of which takes it two and a half times as long; SAC parks as "
            "well",
            "ppo, up to 20 million decisions": "three seeds of ten million; SAC does better with a small part of them",
        },
    ),
    overview=Overview(learner="sac", kmeans="moe-kmeans-10"),
    published=published.VEHICLE,
    perturbations=(
        mismatch("steering gain", "steering_gain"),
        mismatch("speed gain", "speed_gain"),
        disturbance("m/s²", "v", levels=(0.0, 0.2, 0.5, 1.0, 2.0, 5.0)),
        *SENSING,
    ),
    quick=Quick(training=3000, validation=500),
)
