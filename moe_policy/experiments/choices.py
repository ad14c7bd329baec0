"""Comparisons from which something is chosen: a margin, tracking weights, a reading of the cost."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.comparison import ComparisonRow
from moe_policy.experiments.records import Record, inline
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class MarginRow(Record):
    """One planner with one margin.

    Args:
        margin: added to the parameter; ``None`` for the optimum.
        row: as in a comparison.
    """

    margin: float | None
    row: ComparisonRow = inline()


@dataclass(frozen=True, kw_only=True)
class Margins(Record):
    """Planners that are asked to exceed a parameter by several margins: ``margin_<env>.json``.

    Args:
        env_id: id of the problem.
        split: set of the initial conditions.
        parameter: name of the parameter that is enlarged.
        cases: number of initial conditions.
        rows: the optimum, then all margins of each planner.
        provenance: of the record.
    """

    env_id: str
    split: str
    parameter: str
    cases: int
    rows: tuple[MarginRow, ...]
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class TrackingRow(Record):
    """One planner tracked with one choice of weights Q = I, R = r I.

    Args:
        control: r.
        terminal: s of the terminal weight s I; ``None`` for that of the infinite horizon.
        room: control authority ρ that is left for tracking.
        row: as in a comparison.
    """

    control: float
    terminal: float | None
    room: float
    row: ComparisonRow = inline()


@dataclass(frozen=True, kw_only=True)
class TrackingChoice(Record):
    """A grid of tracking weights: ``tracking_<env>.json``.

    Args:
        env_id: id of the problem.
        split: set of the initial conditions.
        cases: number of initial conditions.
        rows: all planners with each choice.
        provenance: of the record.
    """

    env_id: str
    split: str
    cases: int
    rows: tuple[TrackingRow, ...]
    provenance: Provenance


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Record):
    """A comparison on a changed problem: ``sensitivity_<env>.json``.

    Args:
        env_id: id of the changed problem.
        cases: number of initial conditions.
        rows: one for each method.
        provenance: of the record.
    """

    env_id: str
    cases: int
    rows: tuple[ComparisonRow, ...]
    provenance: Provenance
