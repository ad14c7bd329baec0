"""Mixtures that know the value gap between families: experts beyond their own border, and a gate trained on regret.

An expert usually learns the instances of its own family, and the gate their classes. Where the optimum of a family
beyond its border is known (:mod:`ocp_envs.data.beyond`), its expert may learn these trajectories as well, and the gate
may minimise the mean regret Σ_k P_k(p) (J_k(p) − J*(p)) / |J*(p)|. All four mixtures of the two kinds of experts with
the two kinds of gates are compared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from torch import Tensor

from moe_policy.learning.architectures import architecture_of, layer_sizes
from moe_policy.learning.clustering import Labels
from moe_policy.learning.fitting import Objective, minimise
from moe_policy.learning.parts import GATE, batch_order, initial_network
from moe_policy.learning.preparation import Prepared
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import experts_of
from moe_policy.planners.modules import MixtureModule, SingleModule
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX
from moe_policy.planners.record import PartReport
from moe_policy.reports.records import Record, Scalar
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.intervals import Spread
from ocp_envs.data.beyond import Beyond
from ocp_envs.data.samples import Samples
from ocp_envs.support.provenance import Provenance

#: Regret of a family that is not known at an instance, and of one that costs more.
LARGEST = 1.0
#: Whether experts learn beyond their border, and whether the gate learns regrets, by the name of the mixture.
VARIANTS: Mapping[str, tuple[bool, bool]] = {
    "own instances, classes": (False, False),
    "beyond the border, classes": (True, False),
    "own instances, regret": (False, True),
    "beyond the border, regret": (True, True),
}
Trained = tuple[SingleModule, PartReport]


@dataclass(frozen=True, eq=False)
class Mixtures:
    """The trainings of mixtures over the families ``labels`` of ``samples``, whose trajectories ``found`` has."""

    samples: Samples
    labels: Labels
    found: Beyond
    settings: TrainingSettings

    def planners(self, seed: int) -> dict[str, NetworkPlanner]:
        """The planners of all :data:`VARIANTS` by name, trained with ``seed``."""
        data = Prepared.of(self.samples, self.settings, seed)
        experts = {further: self._experts(data, further) for further in (False, True)}
        sizes = architecture_of(data.problem).gate
        gates = {
            False: data.classifier("gate", sizes, GATE, self.labels.values, self.labels.k).train(),
            True: self._on_regret(data),
        }
        planners = {}
        for name, (further, regret) in VARIANTS.items():
            networks, reports = zip(gates[regret], *experts[further])
            planners[name] = data.planner(name, MixtureModule(networks[0], networks[1:]), ARGMAX, reports)
        return planners

    def _experts(self, data: Prepared, further: bool) -> list[Trained]:
        """An expert for each family, on its own instances or ``further``."""
        parts = experts_of(data, self.labels, architecture_of(data.problem), self.found if further else None)
        return [part.train() for part in parts]

    def _on_regret(self, data: Prepared) -> Trained:
        """The gate that minimises the mean regret."""
        regret = np.minimum(self.found.excess, LARGEST).astype(np.float32)
        sizes = layer_sizes(data.problem, architecture_of(data.problem).gate, self.labels.k)
        network = initial_network(sizes, data.seed, GATE)

        def loss(x: Tensor, y: Tensor, epoch: int) -> Tensor:
            return (torch.softmax(network(x), dim=1) * y).sum(dim=1).mean()

        objective = Objective(
            name="gate",
            parameters=list(network.parameters()),
            loss=loss,
            examples=dataclasses.replace(data.examples, y=regret),
            batch=self.settings.gate_batch,
            settings=self.settings,
            order=batch_order(data.seed, GATE),
        )
        return network, minimise(objective)


@dataclass(frozen=True, kw_only=True)
class BorderModel(Record):
    """One mixture on the development sets."""

    name: str  # one of :data:`VARIANTS`
    seed: int  # of the training
    at_plan_end: dict[str, int]  # number of rollouts in the goal ball at the plan's end, by set
    test_error: float  # smooth L1 loss on the test split


@dataclass(frozen=True, kw_only=True)
class BorderRow(Record):
    """All seeds of one mixture."""

    name: str  # one of :data:`VARIANTS`
    seeds: tuple[int, ...]  # of the trainings
    at_plan_end: dict[str, Spread]  # number of rollouts in the goal ball at the plan's end, by set
    test_error: Spread  # smooth L1 loss on the test split

    @classmethod
    def of(cls, models: Sequence[BorderModel]) -> Self:
        """The row of ``models``, one for each seed."""
        sets = models[0].at_plan_end
        return cls(
            name=models[0].name,
            seeds=tuple(model.seed for model in models),
            at_plan_end={name: Spread.of([model.at_plan_end[name] for model in models]) for name in sets},
            test_error=Spread.of([model.test_error for model in models]),
        )


@dataclass(frozen=True, kw_only=True)
class Borders(Record):
    """Mixtures with and without the value gap between families: ``borders_<env>.json``."""

    env_id: str  # id of the problem
    cases: dict[str, int]  # number of initial conditions by set, of development
    samples: int  # number of training instances
    families: tuple[int, ...]  # their numbers by family
    margin: float  # largest excess of the cost beyond the border, relative to the best one
    further: int  # number of trajectories beyond the border of their family
    two: int  # number of instances at which at least two families are known
    solves: int  # with which these were found
    seconds: float  # in which they were found
    rows: tuple[BorderRow, ...]  # one for each mixture
    settings: dict[str, Scalar]  # of the trainings
    training_key: str  # of the training database
    provenance: Provenance  # of the record


def _at_plan_end(name: str, title: str) -> Column[BorderRow]:
    return Column(title, lambda row: row.at_plan_end.get(name), with_range("g"))


BORDER_COLUMNS: tuple[Column[BorderRow], ...] = (
    Column("experts, gate", lambda row: row.name),
    _at_plan_end("uniform", "success at the plan's end"),
    _at_plan_end("boundary", "… at the discontinuity"),
    Column("test error", lambda row: row.test_error, with_range(".4f")),
)
