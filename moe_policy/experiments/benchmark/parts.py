"""The parts of a benchmark: what is trained, compared, perturbed and shown of one problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.perturbations import SENSING, Perturbation
from moe_policy.learning.architectures import Hidden
from moe_policy.learning.settings import DEFAULT, TrainingSettings
from moe_policy.planners.margin import Margin
from moe_policy.rl.common import LearnerSettings, RLSettings


@dataclass(frozen=True, kw_only=True)
class Planners:
    """The planners of a problem."""

    compared: tuple[str, ...] = ("snn", "moe-custom")  # networks in all comparisons
    trained: tuple[str, ...] = ("snn", "moe-custom")  # networks that are trained over several seeds
    stored: int | None = None  # number of training solutions in the shipped nearest-neighbour planner; ``None`` for all
    #: what plans keep clear of the constraint, with which the compared networks have rows of their own
    margin: Margin | None = None


@dataclass(frozen=True, kw_only=True)
class Training:
    """How the networks of a problem are trained."""

    settings: TrainingSettings = DEFAULT  # those of all networks, unless another field says otherwise
    instances: int | None = None  # number of training instances, those that were generated first; ``None`` for all
    #: settings by planner of those that have their own, whatever the number of instances
    own: Mapping[str, TrainingSettings] = field(default_factory=dict)
    #: settings by planner of the networks that are also trained on all instances, with one seed, where ``instances``
    #: are fewer
    whole: Mapping[str, TrainingSettings] = field(default_factory=dict)
    #: epochs by number of training instances, for success against training size; the whole set is added to them. Fewer
    #: instances get more epochs, though fewer gradient steps
    sizes: Mapping[int, int] = field(default_factory=dict)
    sized: tuple[str, ...] = ()  # planners trained on each of ``sizes``
    paper: tuple[str, ...] = ()  # planners that are also trained with the paper's settings
    #: the paper's test error of single networks by their hidden layers, for the ablation
    depths: Mapping[Hidden, float] = field(default_factory=dict)
    #: training instances and epochs with which the compared networks are trained over several seeds for the comparison
    #: on splits; ``None`` for the training set and ``settings``
    over_seeds: tuple[int, int] | None = None
    fewer_seeds: int = 3  # maximum number of training seeds of ``sizes`` and ``depths``

    def settings_of(self, count: int | None, name: str = "") -> TrainingSettings:
        """How the network called ``name`` is trained on ``count`` instances, a part of the training set: as on the
        largest of ``sizes`` that is not larger, where there is one; ``None`` for those of the benchmark.
        """
        if name in self.own or count is None:
            return self.own.get(name, self.settings)
        fitting = [size for size in self.sizes if size <= count]
        return replace(self.settings, epochs=self.sizes[max(fitting)]) if fitting else self.settings


@dataclass(frozen=True, kw_only=True)
class Learners:
    """The reinforcement learners of a problem."""

    settings: Mapping[str, LearnerSettings] = field(default_factory=dict)  # by algorithm, as shipped and compared
    #: by algorithm, for a comparison that is made from nothing within minutes
    short: Mapping[str, RLSettings] = field(default_factory=dict)
    #: what was not tried, or not as far as possible, and why
    unattempted: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Clusters:
    """Trainings from which the number of k-means clusters is chosen, on the development set."""

    numbers: tuple[int, ...]  # values of k, increasing
    used: int  # the one that all other experiments use
    instances: int  # number of training instances, those that were generated first
    settings: TrainingSettings  # of these trainings

    def __post_init__(self) -> None:
        if self.used not in self.numbers or list(self.numbers) != sorted(set(self.numbers)):
            raise ValueError(f"expected increasing numbers of clusters with {self.used}, got {self.numbers}")


@dataclass(frozen=True)
class Overview:
    """Which of several alike methods stands for all of them in the overview."""

    learner: str | None = None  # the reinforcement learner; ``None`` for no such column
    kmeans: str | None = None  # the mixture over k-means clusters; ``None`` for no such column


@dataclass(frozen=True, kw_only=True)
class Rise:
    """Initial positions that rise past a sphere, so that the optimal path changes the side on which it passes."""

    centre: tuple[float, float, float]  # of the sphere, metres
    radius: float  # of the sphere, metres
    start: tuple[float, float]  # x and y of the initial positions, metres
    heights: tuple[float, float]  # z of the lowest and of the highest one, metres
    count: int  # number of initial positions, equally spaced


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Instances that figures of single cases show."""

    #: parameters around which neighbouring optimal paths are drawn; ``None`` for no such figure
    around: tuple[float, ...] | None = None
    rise: Rise | None = None  # instances along which the optimum changes sides; ``None`` for no such figure


@dataclass(frozen=True)
class Quick:
    """Numbers of instances with which tables and figures are made in minutes."""

    training: int = 1000  # number of training instances
    validation: int = 300  # number of validation instances


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Everything that the experiments do with one problem."""

    short: str  # name of the problem in the names of figures
    planners: Planners = Planners()  # which planners are trained, compared and shipped
    training: Training = Training()  # how they are trained
    learners: Learners = Learners()  # the reinforcement learners
    clusters: Clusters | None = None  # the choice of k; ``None`` where it was not chosen by trainings
    overview: Overview = Overview()  # what the overview shows
    published: Mapping[str, Published] = field(default_factory=dict)  # the paper's values by planner
    perturbations: tuple[Perturbation, ...] = SENSING  # of the plant, for robustness
    figures: Figures = Figures()  # cases that figures show
    quick: Quick = Quick()  # sizes of a run in minutes

    def __post_init__(self) -> None:
        used = {*self.planners.compared, *self.published, *self.training.sized, *self.training.paper}
        if unknown := sorted(used - set(self.planners.trained)):
            raise ValueError(f"{self.short}: {unknown} are used, but only {self.planners.trained} are trained")

    @property
    def shipped(self) -> tuple[str, ...]:
        """Networks in the package: those that are compared, and those whose prediction error the paper gives."""
        given = {name for name, values in self.published.items() if values.validation_error is not None}
        return tuple(name for name in self.planners.trained if name in given or name in self.planners.compared)
