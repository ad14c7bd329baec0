"""Generation with different settings: solves, rate, and how often the optimum is missed.

An instance counts as missed where its cost exceeds the lowest that any settings found by more than a tolerance.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from moe_policy.experiments.generation import Totals
from moe_policy.reports.records import Record, inline
from ocp_envs.data.generation import generate
from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance

#: Relative excess of cost from which an optimum counts as missed.
TOLERANCE = 1e-3
#: Finds what the other settings miss.
THOROUGH = GenerationSettings(starts=20, neighbours=4, lookaround=16, margin=1.0, cold=3)
CHANGES: tuple[dict[str, float], ...] = (
    {},
    {"starts": 4},
    {"starts": 16},
    {"neighbours": 1},
    {"neighbours": 3},
    {"lookaround": 4},
    {"lookaround": 16},
    {"margin": 0.03},
    {"margin": 0.1},
    {"margin": 1.0},
    {"cold": 1},
    {"neighbours": 1, "margin": 0.1},
    {"neighbours": 1, "lookaround": 16, "margin": 0.1},
)


@dataclass(frozen=True, kw_only=True)
class SettingsRow(Record):
    """Generation with one choice of settings; ``missed``: instances whose optimum was missed."""

    settings: object
    seconds: float
    problems_per_second: float
    totals: Totals = inline()
    solves_per_problem: float
    missed: int
    rate_to_default: float


@dataclass(frozen=True, kw_only=True)
class GenerationSpeed(Record):
    """Generation of the same instances with different settings, by name."""

    env_id: str
    problems: int
    seed: int
    tolerance: float
    rows: dict[str, SettingsRow]
    provenance: Provenance


def settings_by_name() -> dict[str, GenerationSettings]:
    """Settings by name: the thorough ones, the default, and the default with something changed."""
    named = {"thorough": THOROUGH}
    for change in CHANGES:
        name = ", ".join(f"{key} {value:g}" for key, value in change.items()) or "default"
        named[name] = dataclasses.replace(DEFAULT_GENERATION, **change)  # type: ignore[arg-type]
    return named


def solvers_by_name() -> dict[str, GenerationSettings]:
    """Settings by name: the default ones with either solver, with the default margin and with a smaller one."""
    named: dict[str, GenerationSettings] = {}
    for name in ("default", "margin 0.1"):
        fatrop = settings_by_name()[name]
        riccati = dataclasses.replace(fatrop.solver, primary="riccati")
        named |= {name: fatrop, f"{name}, riccati": dataclasses.replace(fatrop, solver=riccati)}
    return named


@dataclass(frozen=True, eq=False)
class Run:
    """One generation; ``cost``: the lowest cost of every instance, (B,), +inf where it is unsolved."""

    settings: object
    seconds: float
    totals: Totals
    cost: Array

    @property
    def rate(self) -> float:
        """Instances per second."""
        return len(self.cost) / self.seconds


def measure(problem: OptimalControlProblem, p: Array, settings: GenerationSettings) -> Run:
    """Generate a database of the instances ``p`` (B, np) in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        database = generate(problem, Path(folder) / "rows.zarr", p, settings=settings)
        seconds = time.perf_counter() - began
        return Run(database.settings, seconds, Totals.of(database), database.costs().min(axis=1))


def compare(runs: dict[str, Run]) -> dict[str, SettingsRow]:
    """A row for each of ``runs``, which are of the same instances; one is called "default"."""
    best = np.min([run.cost for run in runs.values()], axis=0)
    return {
        name: SettingsRow(
            settings=run.settings,
            seconds=run.seconds,
            problems_per_second=run.rate,
            totals=run.totals,
            solves_per_problem=run.totals.solves / len(run.cost),
            missed=int((run.cost > best * (1 + TOLERANCE)).sum()),
            rate_to_default=run.rate / runs["default"].rate,
        )
        for name, run in runs.items()
    }
