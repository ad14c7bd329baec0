"""What is trained and compared on each problem: planners, learners, training settings, and the paper's figures.

The scripts take their lists from here, so that a model has one meaning everywhere. The paper is Tang & Hauser,
*Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019), tables I and II.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from moe_policy.learning.architectures import PENDULUM_ABLATION, Hidden
from moe_policy.learning.fitting import DEFAULT, TrainingSettings
from moe_policy.rl.settings import SHORT_SAC, PPOSettings, RLSettings, SACSettings
from ocp_envs.problem import OptimalControlProblem


@dataclass(frozen=True)
class Published:
    """The paper's figures of a model, ``None`` where it gives none.

    Args:
        validation_error: raw smooth L1.
        success: number of successes.
        violation: mean violation of the path constraint at the knots, m.
        test_error: of a single network.
        cluster_sizes: smallest and largest cluster of a mixture.
        gate_accuracy: on the test split.
        expert_test_error: mean and deviation over the experts.
    """

    validation_error: float | None
    success: int | None
    violation: float | None = None
    test_error: float | None = None
    cluster_sizes: tuple[int, int] | None = None
    gate_accuracy: float | None = None
    expert_test_error: tuple[float, float] | None = None


@dataclass(frozen=True)
class Study:
    """What is done with one problem.

    Args:
        compared: planners in the comparison with reinforcement learning.
        models: all planners that are trained over several seeds.
        settings: how they are trained.
        published: the paper's figures, by planner.
        sizes: numbers of training problems, and the epochs of training on so many; the whole training set comes beside
            them. Fewer problems get more epochs, though fewer gradient steps.
        sized: planners trained on each of ``sizes``.
        fewer_seeds: training seeds of the smaller sets and of the ablation, at most.
        ablation: test error of the paper's single networks by their hidden layers.
        learners: how each reinforcement learner of the comparison is trained.
        unattempted: what of reinforcement learning was not tried, or not as far as it might be, and why.
        short_learners: the same for a comparison made anew within minutes.
        paper_settings: planners that are also trained as the paper does.
        stored: how many training problems the shipped nearest-neighbour planner keeps; all where ``None``.
        lookaround: among how many nearest stored solutions the optimal planner looks for modes to start from.
        problems: how many training problems the planners are trained on, those that were solved first; all where
            ``None``.
        margin: parameter that networks are also asked to exceed, and by how much, in rows of their own
            (:mod:`moe_policy.planners.margin`).
        whole: planners that are also trained on all problems, with one seed, where ``problems`` are fewer; and how.
    """

    compared: tuple[str, ...] = ("snn", "moe-custom")
    models: tuple[str, ...] = ("snn", "moe-custom")
    settings: TrainingSettings = DEFAULT
    published: Mapping[str, Published] = field(default_factory=dict)
    sizes: Mapping[int, int] = field(default_factory=dict)
    sized: tuple[str, ...] = ()
    fewer_seeds: int = 3
    ablation: Mapping[Hidden, float] = field(default_factory=dict)
    learners: Mapping[str, RLSettings] = field(default_factory=dict)
    unattempted: Mapping[str, str] = field(default_factory=dict)
    short_learners: Mapping[str, RLSettings] = field(default_factory=dict)
    paper_settings: tuple[str, ...] = ()
    stored: int | None = None
    lookaround: int = 12
    problems: int | None = None
    margin: tuple[str, float] | None = None
    whole: Mapping[str, TrainingSettings] = field(default_factory=dict)

    @property
    def shipped(self) -> tuple[str, ...]:
        """Planners in the package: those that are compared, and those whose prediction error the paper gives."""
        given = {name for name, figures in self.published.items() if figures.validation_error is not None}
        return tuple(name for name in self.models if name in given or name in self.compared)


#: Without a price for being far from the goal PPO learns to stand still: acting costs, and the goal is not found by
#: chance. The noise stays, and the discount is that of SAC.
_SWINGING = PPOSettings(
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

_PENDULUM = Study(
    compared=("snn", "moe-custom", "moe-kmeans-4"),
    models=(
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
    published={
        "snn": Published(0.046, 717, test_error=0.058),
        "moe-custom": Published(0.030, 998, None, None, (388, 505), 0.972, (0.0032, 0.0031)),
        "moe-random": Published(0.035, 829),
        "moe-kmeans-3": Published(0.039, 970),
        "moe-kmeans-4": Published(0.029, 1000),
        "moe-kmeans-10": Published(0.051, 1000),
        "moe-retrained-argmax": Published(0.027, 941),
        "moe-retrained-softmax-1": Published(0.028, 896),
        "moe-retrained-softmax-0.1": Published(0.026, 969),
    },
    sizes={size: DEFAULT.epochs for size in (80, 160, 320, 640)},
    sized=("snn", "moe-custom", "moe-kmeans-4"),
    ablation=dict(zip(((300,), *PENDULUM_ABLATION), (0.058, 0.258, 0.170, 0.232))),
    learners={"sac": SACSettings(), "ppo": _SWINGING},
    unattempted={
        "tqc over seeds": "one trial, stopped early (results/search_tqc_PendulumSwingup-v0.json): it learns from fewer "
        "decisions than SAC, each of which takes it several times as long; SAC solves the task with every seed",
        "ppo, up to 20 million decisions": "where it learns to swing up, success is complete well before the end",
    },
    short_learners={"sac": SHORT_SAC},
    paper_settings=("snn", "moe-custom"),
)

#: Most episodes start near the goal, where a start in the box ends by chance too rarely to learn from.
_PARKING = {"near_starts": 0.7, "hidden": (128, 128)}
#: A potential on the distance teaches PPO within millions of decisions. With the few that SAC can afford it learns to
#: wait; a price on the distance brings it to the goal.
_VEHICLE_SAC = SACSettings(
    steps=300_000,
    gamma=0.98,
    reward_scale=0.002,
    distance_price=100.0,
    evaluate_every=20_000,
    **_PARKING,  # type: ignore[arg-type]
)
_VEHICLE_PPO = PPOSettings(
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
    **_PARKING,  # type: ignore[arg-type]
)

_VEHICLE = Study(
    compared=("snn", "moe-custom", "moe-kmeans-10"),
    models=("snn", "moe-custom", "moe-kmeans-6", "moe-kmeans-10", "moe-kmeans-20"),
    settings=TrainingSettings(epochs=100, learning_rate=3e-3),
    published={
        "snn": Published(0.046, 6729, test_error=0.045),
        "moe-custom": Published(0.019, 9975, None, None, (7266, 45626), 0.987, (0.0018, 0.0014)),
        "moe-kmeans-6": Published(0.031, 9413, None, None, (7228, 28913), 0.977, (0.0088, 0.0082)),
    },
    sizes={3_000: 640, 10_000: 350, 30_000: 200},
    sized=("snn", "moe-custom", "moe-kmeans-10"),
    learners={"sac": _VEHICLE_SAC, "ppo": _VEHICLE_PPO},
    unattempted={
        "tqc over seeds": "one trial (results/search_tqc_GroundVehicle-v0.json): from as many decisions it learns more "
        "than SAC with the same settings, each of which takes it two and a half times as long; SAC parks as well",
        "ppo, up to 20 million decisions": "three seeds of ten million; SAC does better with a small part of them",
    },
    stored=5_000,
)

#: A quadcopter tumbles at once under the noise that parking wants, and under a learner's noise the goal ball of twelve
#: states is never entered: the learner pays for its distance and is to hover at the goal, which the hold takes over.
_FLYING = PPOSettings(
    steps=3_000_000,
    period=0.04,
    gamma=0.99,
    n_envs=256,
    hidden=(128, 128),
    n_steps=32,
    batch_size=2048,
    n_epochs=8,
    learning_rate=1e-3,
    log_std=-3.0,
    reward_scale=1e-3,
    largest_cost=10_000.0,
    distance_price=100.0,
    near_starts=0.7,
    evaluate_every=500_000,
)

_NOT_FLOWN = {
    "sac over seeds": "one trial of 300,000 decisions with what works on the vehicle "
    "(results/search_sac_Quadcopter-v0.json): it does not learn to hover, as PPO does with every seed within two "
    "million, in a fraction of the time",
    "tqc": "takes several times as long a decision as SAC",
    "ppo, 20 million decisions over seeds": "one trial of that length (results/search_ppo_Quadcopter-v0.json)",
}

_QUADCOPTER = Study(
    compared=("snn", "moe-kmeans-4"),
    models=("snn", "moe-kmeans-4"),
    settings=TrainingSettings(epochs=2000, learning_rate=5e-3, batch=32),
    published={
        "snn": Published(4.7e-5, 1000, test_error=8.6e-5),
        "moe-kmeans-4": Published(4.6e-5, 1000, None, None, (2072, 2356), 0.996, (4.6e-5, 9e-6)),
    },
    learners={"ppo": _FLYING},
    unattempted=_NOT_FLOWN,
    stored=2_000,
)

_LARGE = TrainingSettings(epochs=100, learning_rate=3e-3, gate_batch=256)
#: Success says nothing where every plan ends at the goal: the paper counts how far trajectories enter the sphere.
_OBSTACLE = Study(
    compared=("snn", "moe-custom", "moe-kmeans-8"),
    models=("snn", "moe-custom", "moe-kmeans-8", "moe-kmeans-20"),
    settings=_LARGE,
    published={
        "snn": Published(0.024, None, 0.315, 0.014),
        "moe-custom": Published(0.015, None, 0.043, None, (70474, 84280), 0.889, (0.0022, 0.0003)),
        "moe-kmeans-8": Published(0.016, None, 0.167, None, (64682, 101669), 0.964, (0.0052, 0.0027)),
        "moe-kmeans-20": Published(None, None, 0.056),
    },
    sizes={10_000: 300, 30_000: 170},
    sized=("snn", "moe-custom"),
    fewer_seeds=1,
    learners={"ppo": replace(_FLYING, violation_price=500.0)},
    unattempted=_NOT_FLOWN,
    stored=2_000,
    lookaround=2,
    problems=100_000,
    margin=("radius", 0.1),
    # 160 passes of the mixture take about as long as 40 of the single network, which has twelve times the weights that
    # work on a sample.
    whole={
        "snn": replace(_LARGE, epochs=40),
        "moe-custom": replace(_LARGE, epochs=160),
        "moe-kmeans-8": replace(_LARGE, epochs=40),
    },
)

STUDIES: Mapping[str, Study] = MappingProxyType(
    {
        "PendulumSwingup-v0": _PENDULUM,
        "GroundVehicle-v0": _VEHICLE,
        "Quadcopter-v0": _QUADCOPTER,
        "QuadcopterObstacle-v0": _OBSTACLE,
    }
)


def study_of(problem: OptimalControlProblem) -> Study:
    """The study of ``problem``; a problem of the user's own has a single network and a mixture over its modes."""
    return STUDIES.get(problem.id, Study())
