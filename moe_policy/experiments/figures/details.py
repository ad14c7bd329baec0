"""What figures show, as records: the drawn cases and the values that belong to them."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.reports.records import ABSENT, Absent, Record, renamed
from ocp_envs.support.provenance import Provenance

Numbers = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Sizes(Record):
    """Numbers of samples in the clusters that are drawn."""

    sizes: tuple[int, ...]  # one for each cluster


@dataclass(frozen=True, kw_only=True)
class PartitionSizes(Record):
    """Numbers of samples in the clusters of several partitions."""

    sizes: dict[str, tuple[int, ...]]  # one for each cluster, by the name of the partition


@dataclass(frozen=True, kw_only=True)
class Case(Record):
    """One instance."""

    parameters: Numbers  # its p, (np,)


@dataclass(frozen=True, kw_only=True)
class DiscontinuityCase(Record):
    """An instance at which two solution families have nearly equal costs."""

    parameters: Numbers  # its p, (np,)
    #: relative cost of the second family, J₂ / J₁ − 1
    cost_difference: float = renamed("relative_cost_of_the_second_mode")


@dataclass(frozen=True, kw_only=True)
class RiseCase(Record):
    """Instances with rising initial positions, along which the optimum changes sides."""

    parameters: tuple[Numbers, ...]  # their p, (K, np)
    #: of the family of the first instance, followed upwards; ``None`` where it ends
    costs_from_below: tuple[float | None, ...]
    costs_from_above: tuple[float | None, ...]  # of the family of the last instance, followed downwards
    between: Numbers = renamed("flip_between")  # heights between which the optimum changes, metres
    #: of the path constraint by the plans of each planner, metres, (K,) each
    violations: dict[str, tuple[float | None, ...]]


@dataclass(frozen=True, kw_only=True)
class MeanViolations(Record):
    """Mean violations of the path constraint."""

    mean: dict[str, float]  # by planner, metres


@dataclass(frozen=True, kw_only=True)
class Details(Record):
    """What there is to say about the figures of one problem, by the name of the figure."""

    jump: DiscontinuityCase | Absent = ABSENT
    clusters: PartitionSizes | Absent = ABSENT
    samples: Sizes | Absent = ABSENT
    interpolation: Case | Absent = ABSENT
    around: Case | Absent = ABSENT
    flip: RiseCase | Absent = ABSENT
    violations: MeanViolations | Absent = ABSENT


@dataclass(frozen=True, kw_only=True)
class Figure(Record):
    """A figure of the paper that was drawn again: ``figure_<name>.json``."""

    quick: bool  # whether it is drawn from few instances
    details: dict[str, object] | Absent = ABSENT  # what it shows; absent where there is nothing to say
    env_id: str | Absent = ABSENT  # id of the problem; absent for a sketch, as the rest
    training: int | Absent = renamed("training_problems", ABSENT)  # number of training instances
    validation: int | Absent = renamed("validation_problems", ABSENT)  # number of validation instances
    models: dict[str, int] | Absent = ABSENT  # training seed of each network by name
    provenance: Provenance  # of the record
