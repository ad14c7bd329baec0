"""Methods on plants that differ from the model (:mod:`moe_policy.experiments.perturbations`), level by level.

Planners and policies know the nominal problem alone. Every level is a set of arguments of the environments
(:class:`ocp_envs.Env`), so all methods run through the common loop.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from moe_policy.control.estimation import Estimated
from moe_policy.experiments.perturbations import Perturbation
from moe_policy.planners.repaired import Repaired
from moe_policy.protocols import Policy
from moe_policy.reports.records import ABSENT, Absent, Record, inline
from moe_policy.reports.tables import Column, text_table
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.intervals import Proportion
from moe_policy.rollouts.metrics import Metrics, evaluate
from moe_policy.rollouts.rollout import rollout
from moe_policy.score.method import Method
from ocp_envs.envs.options import EnvArguments
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class PlantRow(Record):
    """One method on one plant."""

    name: str  # of the method
    reached: Proportion  # episodes that entered the goal ball
    success: Proportion  # episodes in the goal ball at the evaluation time
    success_at_plan_end: Proportion | None  # the same at the plan's end, before regulation; ``None`` without a plan
    left_box: int  # episodes that left the operating box
    violation_mean: float | None  # mean of the maximum violation on the path, metres; ``None`` without constraints
    knot_violation_mean: float | None  # the same at the plan's knots; ``None`` without plan or constraints
    success_clear: dict[str, Proportion] | Absent | None = ABSENT  # as in the metrics; older files lack it

    @classmethod
    def of(cls, name: str, metrics: Metrics) -> Self:
        """The row of the method ``name`` with ``metrics``."""
        return cls(
            name=name,
            reached=metrics.reached,
            success=metrics.success,
            success_at_plan_end=metrics.success_at_plan_end,
            left_box=metrics.left_box,
            violation_mean=None if metrics.violation is None else metrics.violation.mean.mean,
            knot_violation_mean=None if metrics.knot_violation is None else metrics.knot_violation.mean.mean,
            success_clear=metrics.success_clear,
        )

    @property
    def regulation_matters(self) -> bool:
        """Whether success at the evaluation time differs from success at the plan's end."""
        return self.success_at_plan_end is not None and self.success_at_plan_end != self.success


@dataclass(frozen=True, kw_only=True)
class LevelRow(Record):
    """One method at one level of a perturbation."""

    perturbation: str  # its name
    level: float  # in the unit of the perturbation
    outcome: PlantRow = inline()  # of the method on this plant


@dataclass(frozen=True, kw_only=True)
class Robustness(Record):
    """All methods of one problem on all plants: ``robustness_<env>.json``."""

    env_id: str  # id of the problem
    cases: int  # number of initial conditions
    seed: int  # of noise and disturbances
    dt: float  # control period, seconds
    perturbations: tuple[Perturbation, ...]  # in what the plants differ from the model
    rows: tuple[LevelRow, ...]  # one for each perturbation, level and method
    cpu_seconds: float  # processor time
    provenance: Provenance  # of the record

    def beside(self, other: Self) -> Self:
        """This record with the rows of ``other``, which has the same perturbations, before its own."""
        names = set(self.methods)
        return replace(self, rows=(*(row for row in other.rows if row.outcome.name not in names), *self.rows))

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in the order of the rows."""
        return list(dict.fromkeys(row.outcome.name for row in self.rows))

    def rows_of(self, perturbation: Perturbation, method: str) -> list[LevelRow]:
        """The rows of ``method`` for ``perturbation``, one a level."""
        return [row for row in self.rows if (row.perturbation, row.outcome.name) == (perturbation.name, method)]

    def tables(self) -> str:
        """Successes of each method by level, as text, with one table for each perturbation."""
        return "\n".join(self._table(perturbation) for perturbation in self.perturbations)

    def _table(self, perturbation: Perturbation) -> str:
        lines = [(name, rows) for name in self.methods if (rows := self.rows_of(perturbation, name))]
        columns: list[Column[tuple[str, list[LevelRow]]]] = [
            Column(f"{perturbation.name}, {perturbation.unit}", lambda line: line[0]),
            *(Column(f"{level:g}", _successes(i)) for i, level in enumerate(perturbation.levels)),
        ]
        return text_table(lines, columns)


def _successes(i: int) -> Any:
    return lambda line: line[1][i].outcome.success.count


@dataclass(frozen=True, kw_only=True)
class Plant(Record):
    """All methods on one plant, as it is stored between runs."""

    arguments: object  # of the environments
    rows: tuple[PlantRow, ...]  # one for each method
    cpu_seconds: float  # processor time


def plant_key(identity: str, arguments: Mapping[str, object]) -> str:
    """A short name for everything that the rows of a plant depend on.

    ``identity`` names all but the plant; equal ``arguments``, such as those of all nominal plants, are one plant.
    """
    told = json.dumps([identity, arguments], sort_keys=True, default=lambda values: values.tolist())
    return hashlib.sha256(told.encode()).hexdigest()[:16]


def estimated(
    problem: OptimalControlProblem, methods: Sequence[Method], arguments: EnvArguments, dt: float = 0.02
) -> list[Method]:
    """The ``methods`` for ``problem``, acting on an estimate, on the plant of ``arguments`` with control period ``dt``.

    Its delay and the deviations of its noise and disturbance are known, its constants are not. Without noise, an offset
    at the control is estimated and removed; from noisy measurements it would be noisy itself.
    """
    noise, disturbance = arguments.get("observation_noise", 0.0), arguments.get("disturbance", 0.0)
    delay, offset = arguments.get("delay", 0), not np.any(np.asarray(noise))

    def on_estimates(policy: Policy) -> Estimated:
        return Estimated(policy, problem, dt, delay=delay, noise=noise, disturbance=disturbance, offset=offset)

    return [Method(f"{method.name}, estimated", on_estimates(method.policy(problem, dt))) for method in methods]


def informed(method: Method, arguments: EnvArguments) -> Method:
    """The planner of ``method``, which knows the constants of the plant of ``arguments``: its plans are solved for it.

    Raises:
        TypeError: a method that is no planner.
    """
    if method.planner is None:
        raise TypeError(f"{method.name}: expected a planner")
    constants = {name: float(np.asarray(value)) for name, value in (arguments.get("constants") or {}).items()}
    planner = Repaired(method.planner, constants=constants)
    return Method(f"{method.name}, constants known", planner)


def at_all_levels(perturbation: Perturbation, found: Sequence[Sequence[PlantRow]]) -> list[LevelRow]:
    """The rows ``found`` at each level of ``perturbation``, of the methods that were run at all of them."""
    names = [{row.name for row in rows} for rows in found]
    return [
        LevelRow(perturbation=perturbation.name, level=level, outcome=row)
        for level, rows in zip(perturbation.levels, found)
        for row in rows
        if all(row.name in there for there in names)
    ]


def run_plant(
    problem: OptimalControlProblem,
    methods: Sequence[Method],
    parameters: Array,
    arguments: EnvArguments,
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> tuple[PlantRow, ...]:
    """Run all methods from ``parameters`` (B, np) on the plant of ``arguments`` (:meth:`Perturbation.arguments`).

    Noise and disturbances are drawn with ``seed`` for each episode separately, so that equal episodes of all methods
    have the same draws, at another level multiplied by another factor.
    """
    rows = []
    for method in methods:
        envs = environments(problem, len(parameters), dt, **arguments)
        envs.reset(seed=seed)  # rollout itself does not seed
        rows.append(PlantRow.of(method.name, evaluate(problem, rollout(envs, method.policy(problem, dt), parameters))))
        envs.close()
    return tuple(rows)
