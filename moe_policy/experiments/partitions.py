"""Ways to split one family of optimal trajectories that is too steep for one expert, compared on the development set.

Each partition says which instances an expert learns; the mixtures over all partitions are trained on the same instances
for as many epochs. Experts either begin with random weights or, for half of the epochs, are one network that learns all
instances (``together``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from sklearn.cluster import KMeans
from torch import Tensor
from torch.nn import functional as F

from moe_policy.learning.architectures import Hidden, architecture_of, layer_sizes
from moe_policy.learning.clustering import Labels, cluster
from moe_policy.learning.families import steepness
from moe_policy.learning.graph_cuts import parts_of, symmetric
from moe_policy.learning.parts import FIRST_EXPERT, GATE, initial_network
from moe_policy.learning.preparation import Prepared
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_single
from moe_policy.planners.modules import SingleModule
from moe_policy.planners.scaling import Standardizer
from moe_policy.reports.metric_columns import METRICS
from moe_policy.reports.records import ABSENT, Absent, Record, Scalar
from moe_policy.reports.tables import Column, with_range
from moe_policy.rollouts.intervals import Spread
from moe_policy.rollouts.metrics import Metrics
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.samples import Samples
from ocp_envs.support.arrays import Ints
from ocp_envs.support.provenance import Provenance

#: Neighbours of an instance in the graph that is cut, and among which residuals are counted.
NEAR = 16
#: Epochs of the network whose residuals are clustered.
FIRST_EPOCHS = 5
#: Of the competition: rounds, epochs in each, error of an expert relative to the mean one that outweighs a factor e of
#: the gate's probability, batch of experts and of the gate.
ROUNDS, EPOCHS, TEMPERATURE, BATCH, GATE_BATCH = 8, 3, 0.3, 64, 256


def by_cuts(samples: Samples, k: int, settings: TrainingSettings) -> Ints:
    """Parts (M,) along normalised cuts of the graph of neighbours, weighted by the steepness of the optimum."""
    pairs = neighbour_pairs(samples.problem.parameters, samples.parameters, NEAR)
    steep = steepness(samples, pairs)
    graph = symmetric(pairs, 1 / (1 + (steep / np.median(steep)) ** 3), len(samples))
    points = samples.parameters / samples.problem.parameters.width
    return parts_of(graph, graph, points, 0.0, len(samples) // 100, k).values


def by_residuals(samples: Samples, k: int, settings: TrainingSettings) -> Ints:
    """Clusters (M,) of the directions of the residuals of a first network; each instance goes to that of most of its
    neighbours.
    """
    few = TrainingSettings(epochs=FIRST_EPOCHS, learning_rate=settings.learning_rate)
    hidden = architecture_of(samples.problem).experts.small
    first = fit_single(samples, settings=few, sizes=layer_sizes(samples.problem, hidden))
    scaler = Standardizer.fit(samples.trajectory.flat())
    residual = scaler.scale(samples.trajectory.flat()) - scaler.scale(first(samples.parameters).flat())
    residual /= np.linalg.norm(residual, axis=1, keepdims=True)
    own = KMeans(n_clusters=k, n_init=4, random_state=0).fit(residual).labels_
    pairs = neighbour_pairs(samples.problem.parameters, samples.parameters, NEAR)
    votes = symmetric(pairs, np.ones(len(pairs)), len(samples)) @ np.eye(k)[own]
    return np.unique(np.asarray(votes.argmax(axis=1)), return_inverse=True)[1]


def by_competition(samples: Samples, k: int, settings: TrainingSettings) -> Ints:
    """Parts (M,) of the experts that err least, weighed against the gate's probabilities; k-means at first.

    In each round experts and gate learn the parts, and each instance goes to the expert of the least
    E_k / (T Ē) − log P_k, with the error E_k of its prediction and the mean error Ē of all instances' own experts.
    """
    data, rate = Prepared.of(samples, settings, 0), settings.learning_rate
    part = torch.from_numpy(np.array(cluster(samples, "kmeans", k=k, n_init=1).values))
    hidden = architecture_of(samples.problem)
    experts = [_Learner(data, hidden.experts.small, None, FIRST_EXPERT + i) for i in range(k)]
    gate = _Learner(data, hidden.gate, k, GATE)
    x, y = data.examples.tensors
    training = torch.from_numpy(data.examples.split.training)
    for round_ in range(ROUNDS):
        step = rate * (1 + np.cos(np.pi * round_ / ROUNDS)) / 2
        for i, expert in enumerate(experts):
            expert.learn(x, y, training[part[training] == i], step, BATCH, F.smooth_l1_loss)
        gate.learn(x, part, training, step, GATE_BATCH, F.cross_entropy)
        errors = torch.stack([expert.errors(x, y) for expert in experts], dim=1)
        own = errors.gather(1, part[:, None]).mean()
        part = (errors / (TEMPERATURE * own) - gate.log_probabilities(x)).argmin(dim=1)
    return np.unique(part.numpy(), return_inverse=True)[1]


class _Learner:
    """A network of the competition, with its optimiser."""

    def __init__(self, data: Prepared, hidden: Hidden, outputs: int | None, stream: int) -> None:
        self.network: SingleModule = initial_network(layer_sizes(data.problem, hidden, outputs), data.seed, stream)
        self._optimiser = torch.optim.Adam(self.network.parameters(), fused=True)
        self._order = torch.Generator().manual_seed(stream)

    def learn(
        self, x: Tensor, y: Tensor, rows: Tensor, rate: float, batch: int, loss: Callable[[Tensor, Tensor], Tensor]
    ) -> None:
        """Take the steps of some epochs on ``rows``."""
        self._optimiser.param_groups[0]["lr"] = rate
        for _ in range(EPOCHS):
            for chosen in rows[torch.randperm(len(rows), generator=self._order)].split(batch):
                value = loss(self.network(x[chosen]), y[chosen])
                self._optimiser.zero_grad(set_to_none=True)
                value.backward()
                self._optimiser.step()

    @torch.no_grad()
    def errors(self, x: Tensor, y: Tensor) -> Tensor:
        """The smooth L1 loss of each row, (M,)."""
        parts = zip(x.split(8192), y.split(8192))
        return torch.cat([F.smooth_l1_loss(self.network(a), b, reduction="none").mean(dim=1) for a, b in parts])

    @torch.no_grad()
    def log_probabilities(self, x: Tensor) -> Tensor:
        """Of the classes of each row, (M, k)."""
        return torch.cat([F.log_softmax(self.network(a), dim=1) for a in x.split(8192)])


#: The partitions that are compared with those of ``moe_policy.cluster``, by name: (samples, k, settings) → parts.
CANDIDATES: dict[str, Callable[[Samples, int, TrainingSettings], Ints]] = {
    "cuts": by_cuts,
    "residuals": by_residuals,
    "competition": by_competition,
}


def partition(samples: Samples, name: str, k: int, settings: TrainingSettings) -> Labels:
    """The partition ``name`` of ``samples`` into ``k``: of :data:`CANDIDATES`, or of ``moe_policy.cluster``."""
    if name not in CANDIDATES:
        return cluster(samples, name, k=None if name == "custom" else k)
    values = CANDIDATES[name](samples, k, settings)
    return Labels(values, tuple(f"part {i}" for i in range(values.max() + 1)), name)


@dataclass(frozen=True, kw_only=True)
class PartitionModel(Record):
    """One network on the development set."""

    name: str  # of the partition; ``snn`` for none
    together: float  # fraction of the epochs in which the experts were one network
    seed: int  # of the training
    sizes: tuple[int, ...]  # numbers of instances of the parts
    gate_accuracy: float | None  # on the test split
    test_error: float  # smooth L1 loss on the test split
    training_seconds: float  # duration of the training
    metrics: dict[str, float]  # by key

    @staticmethod
    def values(metrics: Metrics) -> dict[str, float]:
        """All ``metrics`` that there are, by key."""
        found = {metric.key: metric.value(metrics) for metric in METRICS}
        return {key: value for key, value in found.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class PartitionRow(Record):
    """All seeds of one partition."""

    name: str  # of the partition
    k: int  # number of its parts
    together: float  # fraction of the epochs in which the experts were one network
    seconds: float | Absent = ABSENT  # in which the partition was found; absent for networks of other experiments
    metrics: dict[str, Spread]  # over the seeds, by key
    models: tuple[PartitionModel, ...]  # one for each seed

    @classmethod
    def of(cls, models: Sequence[PartitionModel], seconds: float | Absent) -> Self:
        """The row of ``models``, one for each seed."""
        keys = models[0].metrics
        spreads = {key: Spread.of([model.metrics[key] for model in models]) for key in keys}
        first = models[0]
        sizes = max(len(first.sizes), 1)
        return cls(
            name=first.name, k=sizes, together=first.together, seconds=seconds, metrics=spreads, models=tuple(models)
        )


@dataclass(frozen=True, kw_only=True)
class Partitions(Record):
    """Mixtures over several partitions of one family: ``partitions_<env>.json``."""

    env_id: str  # id of the problem
    split: str  # set of the initial conditions
    cases: int  # number of initial conditions
    samples: int  # number of training instances
    settings: dict[str, Scalar]  # of the trainings
    rows: tuple[PartitionRow, ...]  # one for each partition
    training_key: str  # of the training database
    provenance: Provenance  # of the record


def _spread(key: str, title: str, form: str) -> Column[PartitionRow]:
    return Column(title, lambda row: row.metrics.get(key), with_range(form))


def _median(row: PartitionRow, of: Callable[[PartitionModel], float | None]) -> float | None:
    found = [value for model in row.models if (value := of(model)) is not None]
    return float(np.median(found)) if found else None


PARTITION_COLUMNS: tuple[Column[PartitionRow], ...] = (
    Column("partition", lambda row: row.name),
    Column("parts", lambda row: row.k),
    Column("together", lambda row: row.together, ".1f"),
    _spread("success_clear_0.01", "at the goal, within 1 cm", "g"),
    _spread("success_clear_0.05", "… within 5 cm", "g"),
    _spread("violation_mean", "mean violation on the whole path, m", ".3f"),
    _spread("success_at_plan_end", "success at the plan's end", "g"),
    Column("gate accuracy", lambda row: _median(row, lambda model: model.gate_accuracy), ".3f"),
    Column("test error", lambda row: _median(row, lambda model: model.test_error), ".4f"),
    Column("training, s", lambda row: _median(row, lambda model: model.training_seconds), ".0f"),
)
