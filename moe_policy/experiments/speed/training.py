"""Where the time of training goes: the parts of an epoch, and what a second thread or a second process gains."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch

from moe_policy.learning.architectures import architecture_of, layer_sizes
from moe_policy.learning.examples import Examples, Split
from moe_policy.learning.fitting import Objective
from moe_policy.learning.settings import DEFAULT
from moe_policy.planners.modules import SingleModule
from moe_policy.reports.records import Record
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import load
from ocp_envs.support.provenance import Provenance

#: What an epoch consists of.
PARTS = ("order", "rows of a minibatch", "forward", "backward", "optimiser", "test loss")
_SEED = 606


@dataclass(frozen=True, kw_only=True)
class TrainingRow(Record):
    """An epoch of the single network of one problem, on random data.

    ``fraction`` of its time by part, with one thread; ``ratio``: samples per second with two threads, and of two
    processes that train at once, to those of one thread.
    """

    env_id: str
    sizes: tuple[int, ...]
    batch: int
    samples_per_second: float
    fraction: dict[str, float]
    ratio: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class TrainingSpeed(Record):
    """Epochs of ``samples`` random samples, medians over ``epochs`` of them."""

    samples: int
    epochs: int
    rows: tuple[TrainingRow, ...]
    provenance: Provenance


def objective_of(problem: OptimalControlProblem, samples: int) -> Objective:
    """The training of the single network of ``problem`` on so many random ``samples``."""
    rng = np.random.default_rng(_SEED)
    x, y = (rng.normal(size=(samples, n)).astype(np.float32) for n in (len(problem.parameters), problem.flat_size))
    module = SingleModule(layer_sizes(problem, architecture_of(problem).single), torch.Generator().manual_seed(_SEED))
    return Objective(
        name="single",
        parameters=list(module.parameters()),
        loss=lambda inputs, wanted, epoch: torch.nn.functional.smooth_l1_loss(module(inputs), wanted),
        examples=Examples(x, y, Split.draw(samples, DEFAULT.test_share, _SEED)),
        batch=DEFAULT.batch,
        settings=DEFAULT,
        order=torch.Generator().manual_seed(_SEED),
    )


def _optimiser(objective: Objective) -> torch.optim.Optimizer:
    return torch.optim.Adam(objective.parameters, lr=objective.settings.learning_rate, fused=True)


def rate(env_id: str, samples: int, epochs: int, threads: int) -> float:
    """Training samples per second of the problem ``env_id`` with ``threads``: the median over ``epochs``, after one.

    Epochs have ``samples`` samples, those of the test split included.
    """
    with _threads(threads):
        objective, taken = objective_of(load(env_id), samples), []
        optimiser = _optimiser(objective)
        for epoch in range(epochs + 1):
            began = time.perf_counter()
            objective.epoch(optimiser, epoch)
            objective.examples.test_loss(objective.loss, epoch)
            taken.append(time.perf_counter() - began)
    return len(objective.examples.split.training) / float(np.median(taken[1:]))


def fractions(env_id: str, samples: int) -> dict[str, float]:
    """The fraction of an epoch of ``samples`` samples that each of `PARTS` takes, of the problem ``env_id``."""
    with _threads(1):
        objective = objective_of(load(env_id), samples)
        optimiser, seconds = _optimiser(objective), dict.fromkeys(PARTS, 0.0)
        for _ in range(2):  # the first one warms up
            seconds = dict.fromkeys(PARTS, 0.0)
            for part, spent in _epoch(objective, optimiser):
                seconds[part] += spent
    whole = sum(seconds.values())
    return {part: spent / whole for part, spent in seconds.items()}


def _epoch(objective: Objective, optimiser: torch.optim.Optimizer) -> Iterator[tuple[str, float]]:
    """The parts of one epoch, as :meth:`Objective.epoch` takes them, with their durations in seconds."""
    order, gathered, forward, backward, step, test = PARTS
    (x, y), before = objective.examples.tensors, time.perf_counter()

    def since() -> float:
        nonlocal before
        last, before = before, time.perf_counter()
        return before - last

    training = torch.from_numpy(objective.examples.split.training)
    batches = training[torch.randperm(len(training), generator=objective.order)].split(objective.batch)
    yield order, since()
    for rows in batches:
        inputs, wanted = x[rows], y[rows]
        yield gathered, since()
        value = objective.loss(inputs, wanted, 0)
        yield forward, since()
        optimiser.zero_grad(set_to_none=True)
        value.backward()
        yield backward, since()
        optimiser.step()
        yield step, since()
    objective.examples.test_loss(objective.loss)
    yield test, since()


def training_row(problem: OptimalControlProblem, samples: int, epochs: int, two: Executor) -> TrainingRow:
    """The row of ``problem`` for ``epochs`` of ``samples`` samples; ``two`` has two processes."""
    work = (problem.id, samples, epochs)
    one, threads = rate(*work, 1), rate(*work, 2)
    at_once = [two.submit(rate, *work, 1) for _ in range(2)]
    together = sum(future.result() for future in at_once)
    return TrainingRow(
        env_id=problem.id,
        sizes=layer_sizes(problem, architecture_of(problem).single),
        batch=DEFAULT.batch,
        samples_per_second=one,
        fraction=fractions(problem.id, samples),
        ratio={"two threads": threads / one, "two processes": together / one},
    )


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """A context in which PyTorch calculates with ``count`` threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
