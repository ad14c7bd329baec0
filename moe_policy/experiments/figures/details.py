"""What figures show, as records: the drawn cases and the values that belong to them."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.records import ABSENT, Absent, Record, renamed
from ocp_envs.support.provenance import Provenance

Numbers = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Sizes(Record):
    """Numbers of samples in the clusters that are drawn.

    Args:
        sizes: one for each cluster.
    """

    sizes: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class PartitionSizes(Record):
    """Numbers of samples in the clusters of several partitions.

    Args:
        sizes: one for each cluster, by the name of the partition.
    """

    sizes: dict[str, tuple[int, ...]]


@dataclass(frozen=True, kw_only=True)
class Case(Record):
    """One instance.

    Args:
        parameters: its p, (np,).
    """

    parameters: Numbers


@dataclass(frozen=True, kw_only=True)
class DiscontinuityCase(Record):
    """An instance at which two solution families have nearly equal costs.

    Args:
        parameters: its p, (np,).
        cost_difference: relative cost of the second family, J₂ / J₁ − 1.
    """

    parameters: Numbers
    cost_difference: float = renamed("relative_cost_of_the_second_mode")


@dataclass(frozen=True, kw_only=True)
class RiseCase(Record):
    """Instances with rising initial positions, along which the optimum changes sides.

    Args:
        parameters: their p, (K, np).
        costs_from_below: of the family of the first instance, followed upwards; ``None`` where it ends.
        costs_from_above: of the family of the last instance, followed downwards.
        between: heights between which the optimum changes, metres.
        violations: of the path constraint by the plans of each planner, metres, (K,) each.
    """

    parameters: tuple[Numbers, ...]
    costs_from_below: tuple[float | None, ...]
    costs_from_above: tuple[float | None, ...]
    between: Numbers = renamed("flip_between")
    violations: dict[str, tuple[float | None, ...]]


@dataclass(frozen=True, kw_only=True)
class MeanViolations(Record):
    """Mean violations of the path constraint.

    Args:
        mean: by planner, metres.
    """

    mean: dict[str, float]


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
    """A figure of the paper that was drawn again: ``figure_<name>.json``.

    Args:
        quick: whether it is drawn from few instances.
        details: what it shows; absent where there is nothing to say.
        env_id: id of the problem; absent for a sketch, as the rest.
        training: number of training instances.
        validation: number of validation instances.
        models: training seed of each network by name.
        provenance: of the record.
    """

    quick: bool
    details: dict[str, object] | Absent = ABSENT
    env_id: str | Absent = ABSENT
    training: int | Absent = renamed("training_problems", ABSENT)
    validation: int | Absent = renamed("validation_problems", ABSENT)
    models: dict[str, int] | Absent = ABSENT
    provenance: Provenance
