"""Training of a mixture as one network (Tang & Hauser, section III-E).

The loss is the smooth L1 (β = 1) of the mixture's standardised output.

- Joint: from random weights, with softmax, ε lowered geometrically towards 0; argmax afterwards.
- Retraining: from decoupled weights, with argmax (the gate has no gradient and does not change) or with softmax at a
  fixed ε.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import cast

from torch import Tensor
from torch.nn import functional as F

from moe_policy.learning.architectures import Architecture, architecture_of, layer_sizes
from moe_policy.learning.fitting import Objective, minimise
from moe_policy.learning.parts import FIRST_EXPERT, GATE, batch_order, initial_network
from moe_policy.learning.preparation import Prepared
from moe_policy.learning.settings import DEFAULT, DEFAULT_ANNEALING, Annealing, TrainingSettings
from moe_policy.planners.modules import MixtureModule, module_of
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX, Argmax, Mixing, MixtureOfExperts, Softmax
from moe_policy.planners.record import PartReport
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked


@checked
def fit_mixture_jointly(
    database: Samples | SampleSource,
    k: int,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    architecture: Architecture | None = None,
    annealing: Annealing = DEFAULT_ANNEALING,
    name: str = "moe-random",
    checkpoints: Path | None = None,
) -> NetworkPlanner:
    """Train a mixture as one network, from random weights.

    Args:
        database: a Database or its samples.
        k: number of experts, all of the small size.
        settings: how the mixture is trained.
        seed: decides the split, the initial weights and the order of minibatches.
        architecture: hidden layers; by default the problem's own.
        annealing: schedule of the softmax's ε.
        name: name of the planner.
        checkpoints: folder of its checkpoints, as in :func:`~moe_policy.fit_single`.

    Raises:
        CheckpointError, FloatingPointError: as :func:`~moe_policy.fit_single` does.
        ValueError: k below 1, or unusable samples.
    """
    check_whole("k", k)
    data = Prepared.of(database, settings, seed, checkpoints=checkpoints)
    chosen = architecture or architecture_of(data.problem)
    gate = initial_network(layer_sizes(data.problem, chosen.gate, k), seed, GATE)
    sizes = layer_sizes(data.problem, chosen.experts.small)
    network = MixtureModule(gate, [initial_network(sizes, seed, FIRST_EXPERT + i) for i in range(k)])

    def mixing(epoch: int) -> Mixing:
        return Softmax(annealing.epsilon(epoch, settings.epochs))

    report = _fit(data, network, mixing, settled=annealing.settled(settings.epochs))
    return data.planner(name, network, ARGMAX, [report], annealing=dataclasses.asdict(annealing))


@checked
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
    """Train the mixture of ``planner`` as one network, from its weights; ``planner`` itself does not change.

    Args:
        planner: a mixture.
        database: a Database or its samples, of the planner's problem; the planner's scalers are kept.
        mixing: ``Argmax()`` or ``Softmax(ε)``, for the loss and for the new planner's predictions.
        settings: how the mixture is trained.
        seed: decides the split and the order of minibatches; that of the planner's training keeps its test split.
        name: name of the planner; by default ``moe-retrained-argmax`` or ``moe-retrained-softmax-<ε>``.
        checkpoints: folder of its checkpoints, as in :func:`~moe_policy.fit_single`.

    Raises:
        CheckpointError, FloatingPointError: as :func:`~moe_policy.fit_single` does.
        TypeError: a single network, or a mixing other than ``Argmax()`` and ``Softmax(ε)``.
        ValueError: samples of another problem, or unusable ones.
    """
    if not isinstance(planner.network, MixtureOfExperts):
        raise TypeError(f"only a mixture can be retrained; {planner.name} is a single network")
    problem = samples_of(database).problem
    if problem.fingerprint != planner.problem.fingerprint:
        raise ValueError(f"the planner is for {planner.problem.id}, the samples of {problem.id} or of a variant of it")
    data = Prepared.of(database, settings, seed, (planner.inputs, planner.outputs), checkpoints)
    network = cast(MixtureModule, module_of(planner.network))
    report = _fit(data, network, lambda epoch: mixing)
    default = f"softmax-{mixing.epsilon:g}" if isinstance(mixing, Softmax) else "argmax"
    pretraining = dict(planner.details)
    return data.planner(name or f"moe-retrained-{default}", network, mixing, [report], pretraining=pretraining)


def _fit(data: Prepared, network: MixtureModule, mixing: Callable[[int], Mixing], settled: int = 0) -> PartReport:
    """Train ``network`` with the mixing of each epoch; weights of epochs before ``settled`` are not kept."""

    def loss(x: Tensor, y: Tensor, epoch: int) -> Tensor:
        return F.smooth_l1_loss(network(x, mixing(epoch)), y)

    # Argmax gives the gate no gradient.
    trained = network.experts if isinstance(mixing(0), Argmax) else network
    objective = Objective(
        name="mixture",
        parameters=list(trained.parameters()),
        loss=loss,
        examples=data.examples,
        batch=data.settings.batch,
        settings=data.settings,
        order=batch_order(data.seed, GATE),
        settled=settled,
    )
    return minimise(objective, data.checkpoint("mixture"))
