"""Minimisation of a loss on minibatches.

Adam (Kingma & Ba, 2015) on shuffled minibatches. The loss on the test split is evaluated after every epoch; it decides
which weights are kept and when to stop.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from moe_policy.learning.checkpoint import Checkpoint, State, identify
from moe_policy.learning.examples import Examples, Loss
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners import calculation
from moe_policy.planners.calculation import DEVICE, DTYPE
from moe_policy.planners.record import PartReport
from ocp_envs.support.progress import Progress

#: Rows of the training split that tell one training's data from another's.
_IDENTIFYING = 100


@dataclass(frozen=True, eq=False)
class Objective:
    """What is minimised, and how; ``name`` is that of the part, for the report and the progress bar.

    Args:
        parameters: the weights that are changed.
        loss: mean loss of a batch of ``examples``, in minibatches of ``batch`` samples.
        settings: epochs, patience and learning rate.
        order: source of the order of the minibatches.
        settled: first epoch whose weights may be kept, for a loss that changes before.
    """

    name: str
    parameters: Sequence[torch.nn.Parameter]
    loss: Loss
    examples: Examples
    batch: int
    settings: TrainingSettings
    order: torch.Generator
    settled: int = 0

    def identity(self) -> str:
        """A hash that tells this minimisation from others, to be taken before it begins."""
        split = self.examples.split
        first = split.training[:_IDENTIFYING]
        data = [tensor[first] for tensor in self.examples.tensors]
        facts = self.name, self.batch, self.settings, self.settled, len(split.training), len(split.test)
        return identify(*facts, tensors=[self.order.get_state(), *data, *(p.detach() for p in self.parameters)])

    def epoch(self, optimiser: torch.optim.Optimizer, epoch: int) -> float:
        """Take the steps of ``optimiser`` in ``epoch`` (from 0); the mean training loss on the way."""
        x, y = self.examples.tensors
        training = torch.from_numpy(self.examples.split.training)
        order = training[torch.randperm(len(training), generator=self.order, device=DEVICE)]
        total = torch.zeros((), dtype=DTYPE, device=DEVICE)
        for rows in order.split(self.batch):  # not x[order]: that would be a copy of all
            value = self.loss(x[rows], y[rows], epoch)
            optimiser.zero_grad(set_to_none=True)
            value.backward()
            optimiser.step()
            total += value.detach() * len(rows)
        return float(total) / len(training)


class Minimisation:
    """How far the minimisation of ``objective`` has come: its losses, its best weights, the state to continue from."""

    #: What is stored in a checkpoint as it is.
    _PLAIN = ("best_epoch", "best", "training_losses", "test_losses", "seconds")

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.optimiser = torch.optim.Adam(objective.parameters, lr=objective.settings.learning_rate, fused=True)
        self.best_epoch = objective.settled
        self.best = self._weights()
        self.training_losses: list[float] = []
        self.test_losses: list[float] = []
        self.seconds = 0.0

    @property
    def epochs(self) -> int:
        """Number of epochs so far."""
        return len(self.test_losses)

    @property
    def finished(self) -> bool:
        """Whether all epochs are done, or so many since the best one that patience is exhausted."""
        settings = self.objective.settings
        impatient = settings.patience is not None and self.epochs - 1 - self.best_epoch >= settings.patience
        return impatient or self.epochs >= settings.epochs

    def advance(self) -> None:
        """Do one more epoch; FloatingPointError where the loss is not finite."""
        began, epoch, objective = time.perf_counter(), self.epochs, self.objective
        self.optimiser.param_groups[0]["lr"] = objective.settings.rate(epoch)
        training = objective.epoch(self.optimiser, epoch)
        test = objective.examples.test_loss(objective.loss, epoch)
        if not math.isfinite(training + test):
            raise FloatingPointError(f"{objective.name}: the loss is not finite in epoch {epoch}; lower learning_rate")
        if epoch <= objective.settled or test < self.test_losses[self.best_epoch]:
            self.best_epoch, self.best = epoch, self._weights()
        self.training_losses.append(training)
        self.test_losses.append(test)
        self.seconds += time.perf_counter() - began

    def _weights(self) -> list[Tensor]:
        return [parameter.detach().clone() for parameter in self.objective.parameters]

    def set_weights(self, values: Sequence[Tensor]) -> None:
        """Set the weights of the objective to ``values``, tensors of the same shapes."""
        with torch.no_grad():
            for parameter, value in zip(self.objective.parameters, values, strict=True):
                parameter.copy_(value)

    def state(self) -> State:
        """All of it, for a checkpoint."""
        return {name: getattr(self, name) for name in self._PLAIN} | {
            "parameters": [parameter.detach() for parameter in self.objective.parameters],
            "optimiser": self.optimiser.state_dict(),
            "order": self.objective.order.get_state(),
        }

    def restore(self, state: State) -> None:
        """Continue from where ``state`` was taken."""
        for name in self._PLAIN:
            setattr(self, name, state[name])
        self.set_weights(state["parameters"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.objective.order.set_state(state["order"])

    def report(self) -> PartReport:
        """The record of the training so far, of at least one epoch."""
        split = self.objective.examples.split
        return PartReport(
            name=self.objective.name,
            training_samples=len(split.training),
            test_samples=len(split.test),
            training_losses=tuple(self.training_losses),
            test_losses=tuple(self.test_losses),
            best_epoch=self.best_epoch,
            test_loss=self.test_losses[self.best_epoch],
            seconds=self.seconds,
        )


@calculation.training()
def minimise(objective: Objective, checkpoint: Path | None = None, progress: bool | None = None) -> PartReport:
    """Minimise ``objective``, whose parameters hold the best weights afterwards. Its state is written to the file
    ``checkpoint`` every minute and at the end; where that exists, the minimisation continues from it and ends with the
    same weights as one that was not interrupted. ``progress`` is shown as :class:`~ocp_envs.support.progress.Progress`
    says, by default on a terminal alone.
    """
    file = None if checkpoint is None else Checkpoint(checkpoint, objective.identity())
    minimisation = Minimisation(objective)
    if file is not None and (state := file.read()) is not None:
        minimisation.restore(state)
    total, done = objective.settings.epochs, minimisation.epochs
    with Progress(total, unit="epoch", label=objective.name, initial=done, shown=progress, leave=False) as shown:
        while not minimisation.finished:
            minimisation.advance()
            shown.update()
            if file is not None and (file.due or minimisation.finished):
                file.write(minimisation.state())
    minimisation.set_weights(minimisation.best)
    return minimisation.report()
