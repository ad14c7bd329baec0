"""The parts of a benchmark: what is trained, compared, perturbed and shown of one problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.perturbations import SENSING, Perturbation
from moe_policy.learning.architectures import Hidden
from moe_policy.learning.settings import DEFAULT, TrainingSettings
from moe_policy.rl.settings import RLSettings


@dataclass(frozen=True)
class Margin:
    """What plans keep clear of the constraint: networks are asked to exceed a parameter.

    Args:
        parameter: name of the parameter.
        amount: added to it, in its unit (:mod:`moe_policy.planners.margin`).
    """

    parameter: str
    amount: float


@dataclass(frozen=True, kw_only=True)
class Planners:
    """The planners of a problem.

    Args:
        compared: networks in all comparisons.
        trained: networks that are trained over several seeds.
        stored: number of training solutions in the shipped nearest-neighbour planner; ``None`` for all.
        margin: with which the compared networks have rows of their own.
    """

    compared: tuple[str, ...] = ("snn", "moe-custom")
    trained: tuple[str, ...] = ("snn", "moe-custom")
    stored: int | None = None
    margin: Margin | None = None


@dataclass(frozen=True, kw_only=True)
class Training:
    """How the networks of a problem are trained.

    Args:
        settings: those of all networks, unless another field says otherwise.
        instances: number of training instances, those that were generated first; ``None`` for all.
        whole: settings by planner of the networks that are also trained on all instances, with one seed, where
            ``instances`` are fewer.
        sizes: epochs by number of training instances, for success against training size; the whole set is added to
            them. Fewer instances get more epochs, though fewer gradient steps.
        sized: planners trained on each of ``sizes``.
        paper: planners that are also trained with the paper's settings.
        depths: the paper's test error of single networks by their hidden layers, for the ablation.
        fewer_seeds: maximum number of training seeds of ``sizes`` and ``depths``.
    """

    settings: TrainingSettings = DEFAULT
    instances: int | None = None
    whole: Mapping[str, TrainingSettings] = field(default_factory=dict)
    sizes: Mapping[int, int] = field(default_factory=dict)
    sized: tuple[str, ...] = ()
    paper: tuple[str, ...] = ()
    depths: Mapping[Hidden, float] = field(default_factory=dict)
    fewer_seeds: int = 3


@dataclass(frozen=True, kw_only=True)
class Learners:
    """The reinforcement learners of a problem.

    Args:
        settings: by algorithm, as shipped and compared.
        short: by algorithm, for a comparison that is made from nothing within minutes.
        unattempted: what was not tried, or not as far as possible, and why.
    """

    settings: Mapping[str, RLSettings] = field(default_factory=dict)
    short: Mapping[str, RLSettings] = field(default_factory=dict)
    unattempted: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Overview:
    """Which of several alike methods stands for all of them in the overview.

    Args:
        learner: the reinforcement learner; ``None`` for no such column.
        kmeans: the mixture over k-means clusters; ``None`` for no such column.
    """

    learner: str | None = None
    kmeans: str | None = None


@dataclass(frozen=True, kw_only=True)
class Rise:
    """Initial positions that rise past a sphere, so that the optimal path changes the side on which it passes.

    Args:
        centre: of the sphere, metres.
        radius: of the sphere, metres.
        start: x and y of the initial positions, metres.
        heights: z of the lowest and of the highest one, metres.
        count: number of initial positions, equally spaced.
    """

    centre: tuple[float, float, float]
    radius: float
    start: tuple[float, float]
    heights: tuple[float, float]
    count: int


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Instances that figures of single cases show.

    Args:
        around: parameters around which neighbouring optimal paths are drawn; ``None`` for no such figure.
        rise: instances along which the optimum changes sides; ``None`` for no such figure.
    """

    around: tuple[float, ...] | None = None
    rise: Rise | None = None


@dataclass(frozen=True)
class Quick:
    """Numbers of instances with which tables and figures are made in minutes.

    Args:
        training: number of training instances.
        validation: number of validation instances.
    """

    training: int = 1000
    validation: int = 300


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Everything that the experiments do with one problem.

    Args:
        short: name of the problem in the names of figures.
        planners: which planners are trained, compared and shipped.
        training: how they are trained.
        learners: the reinforcement learners.
        overview: what the overview shows.
        published: the paper's values by planner.
        perturbations: of the plant, for robustness.
        figures: cases that figures show.
        quick: sizes of a run in minutes.
    """

    short: str
    planners: Planners = Planners()
    training: Training = Training()
    learners: Learners = Learners()
    overview: Overview = Overview()
    published: Mapping[str, Published] = field(default_factory=dict)
    perturbations: tuple[Perturbation, ...] = SENSING
    figures: Figures = Figures()
    quick: Quick = Quick()

    def __post_init__(self) -> None:
        used = {*self.planners.compared, *self.published, *self.training.sized, *self.training.paper}
        if unknown := sorted(used - set(self.planners.trained)):
            raise ValueError(f"{self.short}: {unknown} are used, but only {self.planners.trained} are trained")

    @property
    def shipped(self) -> tuple[str, ...]:
        """Networks in the package: those that are compared, and those whose prediction error the paper gives."""
        given = {name for name, values in self.published.items() if values.validation_error is not None}
        return tuple(name for name in self.planners.trained if name in given or name in self.planners.compared)
