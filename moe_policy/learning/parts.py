"""The training of one network as a self-contained task, which can run in any process."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from moe_policy.learning.examples import Examples
from moe_policy.learning.fitting import Objective, minimise
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.calculation import DEVICE
from moe_policy.planners.modules import SingleModule
from moe_policy.planners.record import PartReport
from ocp_envs.support.progress import track

# Numbers of the random streams. A single network and a first expert share theirs, so that a mixture of one expert is
# the single network.
GATE, FIRST_EXPERT = 0, 1
_WEIGHTS, _ORDER = 0, 1
_Trained = tuple[SingleModule, PartReport]
_Weights = dict[str, NDArray[np.float32]]


def _generator(seed: int, stream: int, purpose: int) -> torch.Generator:
    state = int(np.random.SeedSequence((seed, 1, stream, purpose)).generate_state(1, np.uint64)[0])
    return torch.Generator(DEVICE).manual_seed(state)


def initial_network(sizes: Sequence[int], seed: int, stream: int) -> SingleModule:
    """A network of ``sizes`` with random weights from stream number ``stream`` of the training's ``seed``."""
    return SingleModule(sizes, _generator(seed, stream, _WEIGHTS))


def batch_order(seed: int, stream: int) -> torch.Generator:
    """The source of the order of minibatches from stream number ``stream`` of the training's ``seed``."""
    return _generator(seed, stream, _ORDER)


@dataclass(frozen=True, eq=False)
class Part:
    """The training of one network on its own, called ``name`` in its report.

    Args:
        sizes: layer sizes, input and output included.
        stream: number of its random streams, which depend on ``seed`` as well.
        examples: what it learns; a network that learns classes is a gate.
        settings: how it is trained.
        checkpoint: file of its state, ``None`` to keep none.
        begin: its first weights, random by default.
    """

    name: str
    sizes: tuple[int, ...]
    stream: int
    examples: Examples
    settings: TrainingSettings
    seed: int
    checkpoint: Path | None = None
    begin: _Weights | None = None

    def train(self, progress: bool | None = None) -> _Trained:
        """The trained network and its report; ``progress`` shows its epochs, by default on a terminal alone."""
        network = initial_network(self.sizes, self.seed, self.stream)
        if self.begin is not None:
            network.load_state_dict(_tensors(self.begin))
        gate = self.examples.classified

        def loss(x: Tensor, y: Tensor, epoch: int) -> Tensor:
            return F.cross_entropy(network(x), y) if gate else F.smooth_l1_loss(network(x), y)

        def correct(x: Tensor, classes: Tensor, epoch: int) -> Tensor:
            return (network(x).argmax(dim=1) == classes).double().mean()

        objective = Objective(
            name=self.name,
            parameters=list(network.parameters()),
            loss=loss,
            examples=self.examples,
            batch=self.settings.gate_batch if gate else self.settings.batch,
            settings=self.settings,
            order=batch_order(self.seed, self.stream),
        )
        report = minimise(objective, self.checkpoint, progress)
        return network, dataclasses.replace(report, accuracy=self.examples.test_loss(correct)) if gate else report


def _in_worker(part: Part) -> tuple[_Weights, PartReport]:
    """Train ``part`` with one thread; the weights are arrays, which travel between processes."""
    torch.set_num_threads(1)
    network, report = part.train(progress=False)
    return weights_of(network), report


def weights_of(network: SingleModule) -> _Weights:
    """The weights of ``network``, by name."""
    return {key: value.numpy() for key, value in network.state_dict().items()}


def _tensors(weights: _Weights) -> dict[str, Tensor]:
    return {key: torch.from_numpy(np.array(value)) for key, value in weights.items()}


def _received(part: Part, weights: _Weights) -> SingleModule:
    network = SingleModule(part.sizes)
    network.load_state_dict(_tensors(weights))
    return network


def train_parts(parts: Sequence[Part], executor: Executor | None = None) -> list[_Trained]:
    """The trained networks of ``parts`` and their reports, in order. An ``executor`` of processes trains them in
    parallel, to the same weights; by default they are trained one after the other in this process.
    """
    if executor is None:
        return [part.train() for part in parts]
    # The largest first, so that the small ones even out the load at the end.
    order = sorted(range(len(parts)), key=lambda i: -len(parts[i].examples.x) * sum(parts[i].sizes))
    futures = {executor.submit(_in_worker, parts[i]): i for i in order}
    trained: dict[int, _Trained] = {}
    for future in track(as_completed(futures), len(parts), unit="network", label="training", leave=False):
        i = futures[future]
        weights, report = future.result()
        trained[i] = _received(parts[i], weights), report
    return [trained[i] for i in range(len(parts))]
