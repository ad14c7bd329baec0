"""Training of single networks and of mixtures (Tang & Hauser, sections III-C to III-E).

Regressors minimise the smooth-L1 loss (β = 1) of standardised flat trajectories, gates the cross entropy of the
clusters. All networks of one seed share the split and the scalers, so that their errors can be compared and experts
mixed.

- Decoupled: the gate learns the clusters, each expert its own cluster alone.
- Joint: from random weights, the loss of the softmax mixture, ε lowered geometrically towards 0; argmax afterwards.
- Retraining: the loss of the mixture from decoupled weights, with argmax (the gate has no gradient and stays as it is)
  or with softmax at a fixed ε.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from torch.nn import functional as F

from moe_policy.learning.architectures import Architecture, architecture_of, layer_sizes
from moe_policy.learning.clustering import Labels
from moe_policy.learning.fitting import DEFAULT, PartReport, TrainingSettings, minimise
from moe_policy.learning.preparation import FIRST, GATE, Prepared, train_part, train_parts
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX, Argmax, Mixing, MixtureOfExperts, SingleNetwork, Softmax
from moe_policy.protocols import Planner
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True)
class Annealing:
    """ε of the softmax during joint training: geometric from ``start`` to ``end`` over the first ``share`` of the
    epochs, then constant. Only weights of the constant phase can be kept.
    """

    start: float = 1.0
    end: float = 0.01
    share: float = 0.8

    def __post_init__(self) -> None:
        if not 0 < self.end <= self.start:
            raise ValueError(f"expected 0 < end ≤ start, got start {self.start} and end {self.end}")
        if not 0 <= self.share < 1:
            raise ValueError(f"share must lie in [0, 1), got {self.share}")

    def settled(self, epochs: int) -> int:
        """First epoch of the constant phase."""
        return int(self.share * epochs)

    def epsilon(self, epoch: int, epochs: int) -> float:
        """ε of ``epoch`` out of ``epochs``."""
        progress = min(epoch / max(self.settled(epochs), 1), 1.0)
        return float(self.start * (self.end / self.start) ** progress)


def fit_single(
    database: Samples | SampleSource,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    sizes: Sequence[int] | None = None,
    name: str = "snn",
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train one network on everything.

    Args:
        database: a Database or its samples.
        settings: how.
        seed: decides split, initial weights and order.
        sizes: all layer sizes, such as ``(2, 50, 20, 75)``; by default the problem's own.
        name: name of the planner.
        checkpoints: folder for the state of an unfinished training, of this one alone: the same call goes on from there
            and ends with the same weights. Whoever gives it deletes it.

    Raises:
        CheckpointError: the folder holds the state of another training.
        ValueError: sizes that do not fit the problem, or unusable samples.
    """
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    hidden = architecture_of(data.problem).single if sizes is None else tuple(sizes)[1:-1]
    if sizes is not None and tuple(sizes) != layer_sizes(data.problem, hidden):
        first, last = layer_sizes(data.problem, ())
        raise ValueError(f"{data.problem.id} needs layer sizes ({first}, …, {last}), got {tuple(sizes)}")
    network, report = train_part(data.regressor(hidden, data.split, "single", FIRST))
    return data.planner(name, network, ARGMAX, [report])


def fit_mixture(
    database: Samples | SampleSource,
    labels: Labels,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    architecture: Architecture | None = None,
    mixing: Mixing = ARGMAX,
    name: str | None = None,
    executor: Executor | None = None,
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train the gate on the clusters and each expert on its own cluster (decoupled).

    Args:
        database: a Database or its samples.
        labels: their clusters, from :func:`~moe_policy.cluster`.
        settings: how.
        seed: decides split, initial weights and order.
        architecture: hidden layers; by default the problem's own.
        mixing: how the planner combines its experts; training does not depend on it.
        name: name of the planner; by default ``moe-<method>``, with the number of clusters for k-means.
        executor: trains gate and experts side by side, such as a :class:`ocp_envs.support.pool.WorkerPool`; the
            weights do not depend on it. By default they are trained one after the other, in this process.
        checkpoints: as for :func:`fit_single`.

    Raises:
        CheckpointError: the folder holds the state of another training.
        ValueError: labels of other samples, a cluster without a training sample, or unusable samples.
    """
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    if len(labels) != len(data.x):
        raise ValueError(f"got labels of {len(labels)} samples for {len(data.x)} samples; cluster this database")
    chosen = architecture or architecture_of(data.problem)
    parts = [data.classifier(chosen.gate, labels.values, labels.k, "gate", GATE)]
    for i, size in enumerate(labels.sizes):
        split = data.split.within(labels.values == i)
        if len(split.training) == 0:
            raise ValueError(f"cluster {i} ({labels.names[i]}) of {size} has no training sample; use fewer clusters")
        hidden = chosen.expert(int(size), len(labels) / labels.k, labels.method)
        parts.append(data.regressor(hidden, split, f"expert {i}", FIRST + i))
    (gate, *experts), reports = zip(*train_parts(parts, executor))
    clusters = {
        "method": labels.method,
        "names": list(labels.names),
        "sizes": labels.sizes.tolist(),
        "settings": dict(labels.settings),
    }
    default = f"moe-{labels.method}" + (f"-{labels.k}" if labels.method.startswith("kmeans") else "")
    return data.planner(name or default, MixtureOfExperts(gate, experts), mixing, reports, clusters=clusters)


def _fit_whole(
    data: Prepared, network: MixtureOfExperts, mixing: Callable[[int], Mixing], frozen_gate: bool, settled: int
) -> PartReport:
    module = network.experts if frozen_gate else network
    return minimise(
        list(module.parameters()),
        lambda x, y, epoch: F.smooth_l1_loss(network(x, mixing(epoch)), y),
        data.x,
        data.y,
        data.split,
        name="mixture",
        batch=data.settings.batch,
        settings=data.settings,
        generator=data.order(GATE),
        settled=settled,
        checkpoint=data.checkpoint("mixture"),
    )


def fit_mixture_jointly(
    database: Samples | SampleSource,
    k: int,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    architecture: Architecture | None = None,
    annealing: Annealing = Annealing(),
    name: str = "moe-random",
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train a mixture of ``k`` experts as one network, from random weights, ε lowered by ``annealing``.

    Args:
        database: a Database or its samples.
        k: number of experts.
        settings, seed, architecture, name, checkpoints: as for :func:`fit_mixture`; all experts are of the small size.
        annealing: schedule of ε.

    Raises:
        ValueError: k below 1, or unusable samples.
    """
    if k < 1:
        raise ValueError(f"k must be at least 1, got {k}")
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    chosen = architecture or architecture_of(data.problem)
    gate = data.network(chosen.gate, GATE, k)
    network = MixtureOfExperts(gate, [data.network(chosen.experts.small, FIRST + i) for i in range(k)])

    def mixing(epoch: int) -> Mixing:
        return Softmax(annealing.epsilon(epoch, settings.epochs))

    part = _fit_whole(data, network, mixing, False, annealing.settled(settings.epochs))
    return data.planner(name, network, ARGMAX, [part], annealing=dataclasses.asdict(annealing))


def retrain(
    planner: NetworkPlanner,
    database: Samples | SampleSource,
    mixing: Mixing = ARGMAX,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    name: str | None = None,
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train the mixture of ``planner`` as one network, from its weights; ``planner`` itself is not changed.

    Args:
        planner: a mixture.
        database: a Database or its samples, of the planner's problem; the planner's scalers are kept.
        mixing: ``Argmax()`` or ``Softmax(ε)``, for the loss and for the new planner's predictions.
        settings: how.
        seed: decides split and order; that of the planner's training keeps its test split.
        name: name of the planner; by default ``moe-retrained-argmax`` or ``moe-retrained-softmax-<ε>``.
        checkpoints: as for :func:`fit_single`.

    Raises:
        TypeError: a single network.
        ValueError: samples of another problem, or unusable ones.
    """
    if not isinstance(planner.network, MixtureOfExperts):
        raise TypeError(f"only a mixture can be retrained; {planner.name} is a single network")
    problem = samples_of(database).problem
    if problem.fingerprint != planner.problem.fingerprint:
        raise ValueError(f"the planner is for {planner.problem.id}, the samples of {problem.id} or of a variant of it")
    data = Prepared.of(database, settings, seed, (planner.inputs, planner.outputs), checkpoints)
    old = planner.network
    network = MixtureOfExperts(_copy(old.gate), [_copy(expert) for expert in old.experts])
    part = _fit_whole(data, network, lambda epoch: mixing, isinstance(mixing, Argmax), 0)
    default = f"softmax-{mixing.epsilon:g}" if isinstance(mixing, Softmax) else "argmax"
    pretraining: Mapping[str, Any] = dict(planner.details)
    return data.planner(name or f"moe-retrained-{default}", network, mixing, [part], pretraining=pretraining)


def _copy(network: Any) -> SingleNetwork:
    copy = SingleNetwork(network.sizes)
    copy.load_state_dict(network.state_dict())
    return copy


def test_error(planner: NetworkPlanner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error (β = 1) of standardised outputs, the paper's "test error".

    Args:
        planner: its output scaler is the standard.
        parameters: (B, np).
        trajectories: the B optimal trajectories.
    """
    scale = planner.outputs.scale
    return _smooth_l1(scale(planner(parameters).flat()), scale(trajectories.flat()))


def validation_error(planner: Planner, parameters: ArrayLike, trajectories: Trajectory) -> float:
    """Mean smooth-L1 error (β = 1) of raw outputs, in mixed units, the paper's "validation error".

    NaN where a plan failed.

    Args:
        planner: any planner.
        parameters: (B, np).
        trajectories: the B optimal trajectories.
    """
    p = np.array(parameters, dtype=np.float64, ndmin=2)
    return _smooth_l1(planner(p).flat(), trajectories.flat())


def _smooth_l1(predicted: np.ndarray, wanted: np.ndarray) -> float:
    if predicted.shape != wanted.shape:
        raise ValueError(f"expected as many trajectories as plans, got {wanted.shape} for {predicted.shape}")
    distance = np.abs(predicted - wanted)
    return float(np.where(distance < 1, distance**2 / 2, distance - 0.5).mean())
