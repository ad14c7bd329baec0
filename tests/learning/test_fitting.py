from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from torch import nn

from moe_policy.learning.checkpoint import Checkpoint, CheckpointError
from moe_policy.learning.examples import Examples, Split
from moe_policy.learning.fitting import Minimisation, Objective, minimise
from moe_policy.learning.settings import TrainingSettings

SETTINGS = TrainingSettings(epochs=40, batch=8, learning_rate=0.05)
X = np.random.default_rng(0).standard_normal((50, 2)).astype(np.float32)
#: A line without noise: y = 2 x₁ − x₂.
EXAMPLES = Examples(X, X @ np.array([[2.0], [-1.0]], np.float32), Split(np.arange(40), np.arange(40, 50)))


def objective(settings=SETTINGS, seed=0, settled=0, loss=None, examples=EXAMPLES):
    """The regression of a line by two weights."""
    weight = nn.Parameter(torch.zeros(2, 1))
    return Objective(
        name="line",
        parameters=[weight],
        loss=loss or (lambda x, y, epoch: ((x @ weight - y) ** 2).mean()),
        examples=examples,
        batch=settings.batch,
        settings=settings,
        order=torch.Generator().manual_seed(seed),
        settled=settled,
    )


def wandering(test_losses):
    """An objective whose loss has the given values, epoch by epoch, whatever the weights, which move all the time."""
    task = objective(dataclasses.replace(SETTINGS, epochs=len(test_losses)))
    weight = task.parameters[0]
    values = torch.tensor(test_losses, dtype=torch.float32)
    return dataclasses.replace(task, loss=lambda x, y, epoch: values[epoch] + weight.sum() - weight.sum().detach())


def test_the_minimum_is_found():
    task = objective()
    report = minimise(task)
    np.testing.assert_allclose(task.parameters[0].detach().numpy().ravel(), [2, -1], atol=1e-2)
    assert report.test_loss < 1e-3
    assert (report.name, report.training_samples, report.test_samples, report.epochs) == ("line", 40, 10, 40)


def test_the_weights_of_the_best_epoch_are_kept():
    task = wandering([3.0, 1.0, 2.0, 1.5])
    progress, after = Minimisation(task), []
    while not progress.finished:
        progress.advance()
        after.append(task.parameters[0].detach().clone())
    assert not torch.equal(after[1], after[3])
    again = wandering([3.0, 1.0, 2.0, 1.5])
    report = minimise(again)
    assert (report.best_epoch, report.test_loss) == (1, 1.0)
    assert torch.equal(again.parameters[0].detach(), after[1])


def test_weights_before_the_settled_epoch_are_not_kept():
    task = wandering([1.0, 2.0, 5.0, 4.0, 4.5])
    assert minimise(dataclasses.replace(task, settled=2)).best_epoch == 3


@pytest.mark.parametrize(("patience", "epochs"), [(1, 3), (2, 6), (None, 8)])
def test_patience_counts_epochs_since_the_best(patience, epochs):
    """Epoch 1 is better than epoch 2, and epoch 3 is better than epochs 4 and 5."""
    task = wandering([3.0, 2.0, 2.5, 1.0, 1.0, 1.5, 1.0, 0.5])
    settings = dataclasses.replace(task.settings, patience=patience)
    assert minimise(dataclasses.replace(task, settings=settings)).epochs == epochs


class Stop(Exception):
    """What interrupts a minimisation."""


def stops_after(epochs):
    """The objective with a loss that raises in the epoch of that number."""
    task = objective()

    def loss(x, y, epoch):
        if epoch == epochs:
            raise Stop
        return task.loss(x, y, epoch)

    return dataclasses.replace(task, loss=loss)


@pytest.mark.parametrize("after", [1, 17, 39])
def test_an_interrupted_minimisation_continues_and_ends_with_the_same_weights(tmp_path, monkeypatch, after):
    whole = objective()
    report = minimise(whole)
    monkeypatch.setattr(Checkpoint, "due", True)
    with pytest.raises(Stop):
        minimise(stops_after(after), tmp_path / "line.pt")
    task = objective()
    again = minimise(task, tmp_path / "line.pt")
    assert torch.equal(task.parameters[0], whole.parameters[0])
    assert dataclasses.replace(again, seconds=report.seconds) == report


def test_epochs_that_are_done_are_not_done_again(tmp_path, monkeypatch):
    monkeypatch.setattr(Checkpoint, "due", True)
    with pytest.raises(Stop):
        minimise(stops_after(30), tmp_path / "line.pt")
    seen, task = [], objective()
    counted = dataclasses.replace(task, loss=lambda x, y, epoch: (seen.append(epoch), task.loss(x, y, epoch))[1])
    minimise(counted, tmp_path / "line.pt")
    assert sorted(set(seen)) == list(range(30, 40))


def test_a_finished_minimisation_is_read_and_nothing_is_done(tmp_path):
    first = objective()
    report = minimise(first, tmp_path / "line.pt")
    task = stops_after(0)
    assert minimise(task, tmp_path / "line.pt") == report
    assert torch.equal(task.parameters[0], first.parameters[0])


@pytest.mark.parametrize(
    "other",
    [
        {"settings": TrainingSettings(epochs=41, batch=8, learning_rate=0.05)},
        {"seed": 1},
        {"settled": 1},
        {"examples": dataclasses.replace(EXAMPLES, y=EXAMPLES.y + 1)},
    ],
)
def test_the_checkpoint_of_another_minimisation_is_refused(tmp_path, other):
    minimise(objective(), tmp_path / "line.pt")
    with pytest.raises(CheckpointError, match="other data, settings or seed"):
        minimise(objective(**other), tmp_path / "line.pt")


def test_a_loss_that_is_not_finite_is_an_error():
    with pytest.raises(FloatingPointError, match="line: the loss is not finite in epoch 2; lower learning_rate"):
        minimise(wandering([1.0, 1.0, np.inf, 1.0]))
