"""Training of single networks, and of mixtures from clusters (Tang & Hauser, sections III-C and III-D).

Regressors minimise the smooth-L1 loss (β = 1) of standardised flat trajectories, gates the cross entropy of the
clusters. Training is decoupled: the gate learns the clusters, and each expert learns its own cluster alone. All
networks of one seed share the split and the scalers, so that their errors can be compared and experts mixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from moe_policy.learning.architectures import Architecture, Hidden, architecture_of, layer_sizes
from moe_policy.learning.clustering import Labels
from moe_policy.learning.parts import FIRST_EXPERT, GATE, Part, train_parts, weights_of
from moe_policy.learning.preparation import Prepared
from moe_policy.learning.settings import DEFAULT, TrainingSettings
from moe_policy.planners.modules import MixtureModule
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX, Mixing
from moe_policy.planners.record import PartReport
from ocp_envs.data.beyond import Beyond
from ocp_envs.data.samples import Samples, SampleSource
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.checks import check_number
from ocp_envs.support.doors import checked

#: Name of the networks with which experts begin, followed by a number.
SHARED = "shared"


@checked
def fit_single(
    database: Samples | SampleSource,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    sizes: Sequence[int] | None = None,
    name: str = "snn",
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train one network on all samples.

    Args:
        database: a Database or its samples.
        settings: how the network is trained.
        seed: decides the split, the initial weights and the order of minibatches.
        sizes: all layer sizes, such as ``(2, 50, 20, 75)``; by default the problem's own.
        name: name of the planner.
        checkpoints: folder for the state of this training alone: the same call continues an interrupted training from
            there and ends with the same weights. The caller deletes it afterwards.

    Raises:
        CheckpointError: the folder holds the state of another training.
        FloatingPointError: the loss diverged.
        ValueError: sizes that do not fit the problem, or unusable samples.
    """
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    hidden = architecture_of(data.problem).single if sizes is None else _hidden(data.problem, sizes)
    network, report = data.regressor("single", hidden, FIRST_EXPERT).train()
    return data.planner(name, network, ARGMAX, [report])


def _hidden(problem: OptimalControlProblem, sizes: Sequence[int]) -> Hidden:
    hidden = tuple(sizes)[1:-1]
    if tuple(sizes) != layer_sizes(problem, hidden):
        first, last = layer_sizes(problem, ())
        raise ValueError(f"{problem.id} needs layer sizes ({first}, …, {last}), got {tuple(sizes)}")
    return hidden


@checked
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
    together: float = 0.0,
    beyond: Beyond | None = None,
) -> NetworkPlanner:
    """Train the gate on the clusters and each expert on its own cluster (decoupled).

    Args:
        database: a Database or its samples.
        labels: their clusters, from :func:`~moe_policy.cluster`.
        settings: how the networks are trained.
        seed: decides the split, the initial weights and the order of minibatches.
        architecture: hidden layers; by default the problem's own.
        mixing: how the planner combines its experts; training does not depend on it.
        name: name of the planner; by default ``moe-<method>``, with the number of clusters for k-means.
        executor: trains gate and experts in parallel, such as a :class:`ocp_envs.support.pool.WorkerPool`; the weights
            do not depend on it. By default they are trained one after the other in this process.
        checkpoints: folder of its checkpoints, as in :func:`fit_single`.
        together: fraction of the epochs, at least 0 and below 1, in which all experts of equal layers are one network,
            which learns all samples; where clusters are parts of one family, experts begin with what they share.
        beyond: trajectories of each cluster at samples of others, from :func:`ocp_envs.beyond` with the families of
            ``labels``, which its expert learns as well: where costs differ little, the gate may choose either. At
            strays the gate learns the cheapest cluster that is known there.

    Raises:
        CheckpointError, FloatingPointError: as :func:`fit_single` does.
        TypeError: a mixing other than ``Argmax()`` and ``Softmax(ε)``, or labels of another type.
        ValueError: labels of other samples, a cluster without a training sample, ``together`` out of range, or unusable
            samples.
    """
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    parts = _decoupled(data, labels, architecture or architecture_of(data.problem), beyond)
    first: list[PartReport] = []
    if together:
        parts, first = _begun_together(data, parts, together, executor)
    (gate, *experts), own = zip(*train_parts(parts, executor))
    reports = [*own, *first]
    clusters: dict[str, object] = {
        "method": labels.method,
        "names": list(labels.names),
        "sizes": labels.sizes.tolist(),
        "settings": dict(labels.settings),
    } | ({"together": together} if together else {})
    if labels.strays.any():
        clusters["strays"] = int(labels.strays.sum())
    if beyond is not None:
        clusters["beyond"] = np.bincount(beyond.family, minlength=labels.k).tolist()
    default = f"moe-{labels.method}" + (f"-{labels.k}" if labels.method.startswith("kmeans") else "")
    return data.planner(name or default, MixtureModule(gate, experts), mixing, reports, clusters=clusters)


def _decoupled(data: Prepared, labels: Labels, architecture: Architecture, beyond: Beyond | None) -> list[Part]:
    """The gate and the experts of a mixture over ``labels``, which learn the trajectories ``beyond`` as well."""
    samples = len(data.examples.x)
    if len(labels) != samples:
        raise ValueError(f"got labels of {len(labels)} samples for {samples} samples; cluster this database")
    experts, chosen = experts_of(data, labels, architecture, beyond), labels.values
    if beyond is not None:
        known = labels.strays & np.isfinite(beyond.cost).any(axis=1)
        chosen = np.where(known, beyond.cost.argmin(axis=1), chosen)
    return [data.classifier("gate", architecture.gate, GATE, chosen, labels.k), *experts]


def experts_of(data: Prepared, labels: Labels, architecture: Architecture, beyond: Beyond | None = None) -> list[Part]:
    """The experts of a mixture over ``labels``: with the layers of the ``architecture``, each learns its own cluster of
    the samples ``data`` and, where they are given, trajectories ``beyond``.
    """
    data, family = data.with_beyond(labels.families, labels.k, beyond)
    parts = []
    for i, size in enumerate(labels.sizes):
        own = data.examples.split.within(family == i)
        if len(own.training) == 0:
            raise ValueError(f"cluster {i} ({labels.names[i]}) of {size} has no training sample; use fewer clusters")
        hidden = architecture.expert(int(size), len(labels) / labels.k, labels.method)
        parts.append(data.regressor(f"expert {i}", hidden, FIRST_EXPERT + i, own))
    return parts


def _begun_together(
    data: Prepared, parts: list[Part], together: float, executor: Executor | None
) -> tuple[list[Part], list[PartReport]]:
    """The ``parts`` of a mixture, a gate and experts, with experts that begin as one network for each size, which has
    learnt all samples for the fraction ``together`` of the epochs; and the reports of these networks.
    """
    check_number("together", together, "a number of at least 0 and below 1", 0.0)
    gate, *experts = parts
    epochs = round(together * data.settings.epochs)
    if not 0 < epochs < data.settings.epochs:
        raise ValueError(
            f"together must leave epochs before and after, got {together} of {data.settings.epochs} epochs"
        )
    sizes = sorted({expert.sizes for expert in experts})
    of_all = [
        replace(
            data.regressor(f"{SHARED} {i}", size[1:-1], FIRST_EXPERT), settings=replace(data.settings, epochs=epochs)
        )
        for i, size in enumerate(sizes)
    ]
    trained = train_parts(of_all, executor)
    weights = {size: weights_of(network) for size, (network, _) in zip(sizes, trained)}
    rest = replace(data.settings, epochs=data.settings.epochs - epochs)
    begun = [replace(expert, settings=rest, begin=weights[expert.sizes]) for expert in experts]
    return [gate, *begun], [report for _, report in trained]
