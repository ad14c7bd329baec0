"""Minimisation of one loss on minibatches, and the record of it.

Adam (Kingma & Ba, 2015) on shuffled minibatches; the loss on the test split is taken after every epoch, decides when to
stop, and which weights to keep. The learning rate of epoch e of E follows half a cosine,

    η_e = η (f + (1 − f) (1 + cos(π e / E)) / 2),   f = final_fraction; f = 1 is a constant rate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from moe_policy.learning.checkpoint import Checkpoint, identify
from moe_policy.planners.record import PartReport

#: Rows that a loss is evaluated on at once.
_TOGETHER = 8192
#: Rows of the training split that tell one training's data from another's.
_IDENTIFYING = 100
#: (inputs, wanted outputs, epoch) → mean loss of the batch.
Loss = Callable[[Tensor, Tensor, int], Tensor]


@dataclass(frozen=True)
class TrainingSettings:
    """How networks are trained; the same values serve single networks and mixtures.

    Args:
        epochs: largest number of passes over the training split.
        patience: stop after so many epochs without a better test loss; ``None`` never stops early.
        batch: minibatch of regressors.
        gate_batch: minibatch of gates.
        learning_rate: Adam's step η.
        final_fraction: the learning rate at the end as a fraction of η; 1 keeps it constant.
        test_share: share of the samples in the test split.
    """

    epochs: int = 2000
    patience: int | None = None
    batch: int = 64
    gate_batch: int = 64
    learning_rate: float = 1e-2
    final_fraction: float = 0.01
    test_share: float = 0.2

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "gate_batch"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.patience is not None and self.patience < 1:
            raise ValueError(f"patience must be at least 1 or None, got {self.patience}")
        if not (math.isfinite(self.learning_rate) and self.learning_rate > 0):
            raise ValueError(f"learning_rate must be positive, got {self.learning_rate}")
        if not 0 < self.final_fraction <= 1:
            raise ValueError(f"final_fraction must lie in (0, 1], got {self.final_fraction}")
        if not 0 < self.test_share < 1:
            raise ValueError(f"test_share must lie in (0, 1), got {self.test_share}")

    def rate(self, epoch: int) -> float:
        """η of ``epoch`` (from 0)."""
        f = self.final_fraction
        return self.learning_rate * (f + (1 - f) * (1 + math.cos(math.pi * epoch / self.epochs)) / 2)


#: The project's own settings.
DEFAULT = TrainingSettings()
#: The settings printed by Tang & Hauser.
PAPER = TrainingSettings(epochs=1500, patience=8, gate_batch=256, learning_rate=1e-3, final_fraction=1.0)


@dataclass(frozen=True)
class Split:
    """Row numbers of the training and of the test samples."""

    training: NDArray[np.int64]
    test: NDArray[np.int64]

    @classmethod
    def draw(cls, count: int, test_share: float, seed: int) -> Split:
        """A random split of ``count`` rows: the same for every model of one seed.

        Raises:
            ValueError: fewer than two rows.
        """
        if count < 2:
            raise ValueError(f"a split into training and test needs at least two samples, got {count}")
        order = np.random.default_rng((seed, 0)).permutation(count)
        test = min(max(round(test_share * count), 1), count - 1)
        return cls(np.sort(order[test:]), np.sort(order[:test]))

    def within(self, rows: NDArray[np.bool_]) -> Split:
        """The split restricted to the rows of a mask; where no test row is left, the training rows test."""
        training, test = self.training[rows[self.training]], self.test[rows[self.test]]
        return Split(training, test if len(test) else training)


def generator_for(seed: int, *stream: int) -> torch.Generator:
    """The random numbers of one purpose in one training, independent of every other stream's."""
    state = int(np.random.SeedSequence((seed, 1, *stream)).generate_state(1, np.uint64)[0])
    return torch.Generator().manual_seed(state)


def mean_loss(loss: Loss, inputs: Tensor, outputs: Tensor, rows: NDArray[np.int64], epoch: int) -> float:
    """Mean of ``loss`` over ``rows``, without gradients, some thousand rows at a time."""
    total = 0.0
    with torch.no_grad():
        for part in torch.from_numpy(rows).split(_TOGETHER):
            total += float(loss(inputs[part], outputs[part], epoch)) * len(part)
    return total / len(rows)


@dataclass(eq=False)
class _State:
    """Where a minimisation stands, after a number of epochs."""

    parameters: Sequence[torch.nn.Parameter]
    optimiser: torch.optim.Optimizer
    generator: torch.Generator
    best_epoch: int
    best: list[Tensor]
    training_losses: list[float] = field(default_factory=list)
    test_losses: list[float] = field(default_factory=list)
    finished: bool = False
    seconds: float = 0.0

    _PLAIN = ("best_epoch", "best", "training_losses", "test_losses", "finished", "seconds")

    def record(self) -> dict[str, Any]:
        """All of it, for a checkpoint."""
        return {name: getattr(self, name) for name in self._PLAIN} | {
            "parameters": [parameter.detach() for parameter in self.parameters],
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
        }

    def restore(self, record: dict[str, Any]) -> None:
        """Go back to where ``record`` was taken."""
        for name in self._PLAIN:
            setattr(self, name, record[name])
        self.set_weights(record["parameters"])
        self.optimiser.load_state_dict(record["optimiser"])
        self.generator.set_state(record["generator"])

    def set_weights(self, values: Sequence[Tensor]) -> None:
        with torch.no_grad():
            for parameter, value in zip(self.parameters, values, strict=True):
                parameter.copy_(value)


def minimise(
    parameters: Sequence[torch.nn.Parameter],
    loss: Loss,
    inputs: Tensor,
    outputs: Tensor,
    split: Split,
    *,
    name: str,
    batch: int,
    settings: TrainingSettings,
    generator: torch.Generator,
    settled: int = 0,
    progress: bool | None = None,
    checkpoint: Path | None = None,
) -> PartReport:
    """Minimise ``loss`` over ``parameters``, which hold the best weights afterwards.

    Args:
        parameters: what is changed.
        loss: mean loss of a batch.
        inputs, outputs: (M, …) of all samples.
        split: which of them train and which test.
        name: name of the part, for the record and the progress bar.
        batch: size of a minibatch.
        settings: epochs, patience and learning rate.
        generator: order of the minibatches.
        settled: first epoch whose weights may be kept, for a loss that changes before.
        progress: show a bar; by default on a terminal.
        checkpoint: file of the state, written every minute and at the end; where it is there, the minimisation goes on
            from it and ends with the same weights as one that was not interrupted.

    Raises:
        CheckpointError: the file belongs to another minimisation.
        FloatingPointError: the loss is no longer finite.
    """
    began = time.perf_counter()
    parameters = list(parameters)
    training = torch.from_numpy(split.training)
    optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, fused=True)
    state = _State(parameters, optimiser, generator, settled, [p.detach().clone() for p in parameters])
    kept = None
    if checkpoint is not None:
        first = split.training[:_IDENTIFYING]
        facts = name, batch, settings, settled, len(split.training), len(split.test)
        tensors = generator.get_state(), inputs[first], outputs[first], *state.best
        kept = Checkpoint(checkpoint, identify(*facts, tensors=tensors))
        if (record := kept.read()) is not None:
            state.restore(record)
    before = state.seconds
    epochs = range(len(state.test_losses), 0 if state.finished else settings.epochs)
    hidden = None if progress is None else not progress
    bar = tqdm(epochs, desc=name, initial=epochs.start, total=settings.epochs, disable=hidden, leave=False)
    for epoch in bar:
        optimiser.param_groups[0]["lr"] = settings.rate(epoch)
        training_loss = _one_epoch(optimiser, loss, inputs, outputs, training, batch, epoch, generator)
        test_loss = mean_loss(loss, inputs, outputs, split.test, epoch)
        if not math.isfinite(training_loss + test_loss):
            raise FloatingPointError(f"{name}: the loss is not finite in epoch {epoch}; lower learning_rate")
        state.training_losses.append(training_loss)
        state.test_losses.append(test_loss)
        if epoch <= settled or test_loss < state.test_losses[state.best_epoch]:
            state.best_epoch, state.best = epoch, [p.detach().clone() for p in parameters]
        elif settings.patience is not None and epoch - state.best_epoch >= settings.patience:
            break
        if kept is not None and kept.due:
            state.seconds = before + time.perf_counter() - began
            kept.write(state.record())
    state.set_weights(state.best)
    if not state.finished:
        state.finished, state.seconds = True, before + time.perf_counter() - began
        if kept is not None:
            kept.write(state.record())
    return PartReport(
        name,
        len(split.training),
        len(split.test),
        tuple(state.training_losses),
        tuple(state.test_losses),
        state.best_epoch,
        state.test_losses[state.best_epoch],
        state.seconds,
    )


def _one_epoch(
    optimiser: torch.optim.Optimizer,
    loss: Loss,
    x: Tensor,
    y: Tensor,
    training: Tensor,
    batch: int,
    epoch: int,
    generator: torch.Generator,
) -> float:
    order = training[torch.randperm(len(training), generator=generator)]
    total = torch.zeros(())
    for rows in order.split(batch):  # not x[order]: that would be a copy of all
        value = loss(x[rows], y[rows], epoch)
        optimiser.zero_grad(set_to_none=True)
        value.backward()
        optimiser.step()
        total += value.detach() * len(rows)
    return float(total) / len(training)
