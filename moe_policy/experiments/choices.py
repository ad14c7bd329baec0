"""Comparisons from which something is chosen: a margin, tracking weights, a reading of the cost."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.comparison import ComparisonRow
from moe_policy.experiments.records import Record, inline
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class MarginRow(Record):
    """One planner with one margin."""

    margin: float | None  # added to the parameter; ``None`` for the optimum
    row: ComparisonRow = inline()  # as in a comparison


@dataclass(frozen=True, kw_only=True)
class Margins(Record):
    """Planners that are asked to exceed a parameter by several margins: ``margin_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    parameter: str  # name of the parameter that is enlarged
    cases: int  # number of initial conditions
    rows: tuple[MarginRow, ...]  # the optimum, then all margins of each planner
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class TrackingRow(Record):
    """One planner tracked with one choice of weights Q = I, R = r I."""

    control: float  # r
    terminal: float | None  # s of the terminal weight s I; ``None`` for that of the infinite horizon
    room: float  # control authority ρ that is left for tracking
    row: ComparisonRow = inline()  # as in a comparison


@dataclass(frozen=True, kw_only=True)
class TrackingChoice(Record):
    """A grid of tracking weights: ``tracking_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    cases: int  # number of initial conditions
    rows: tuple[TrackingRow, ...]  # all planners with each choice
    provenance: Provenance  # of the record


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Record):
    """A comparison on a changed problem: ``sensitivity_<env>.json``."""

    env_id: str  # id of the changed problem
    cases: int  # number of initial conditions
    rows: tuple[ComparisonRow, ...]  # one for each method
    provenance: Provenance  # of the record
