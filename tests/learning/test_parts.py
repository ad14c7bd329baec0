from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from moe_policy.learning.examples import Examples, Split
from moe_policy.learning.parts import Part, batch_order, initial_network, train_parts
from moe_policy.learning.settings import TrainingSettings

X = np.random.default_rng(0).uniform(-1, 1, (60, 2)).astype(np.float32)
SPLIT = Split(np.arange(50), np.arange(50, 60))
SETTINGS = TrainingSettings(epochs=30, batch=10, gate_batch=20)
REGRESSOR = Part("expert 0", (2, 8, 2), 1, Examples(X, X[:, ::-1].copy(), SPLIT), SETTINGS, seed=4)
GATE = Part("gate", (2, 8, 2), 0, Examples(X, (X[:, 0] > 0).astype(np.int64), SPLIT), SETTINGS, seed=4)


def test_random_streams_differ_by_seed_by_part_and_by_purpose():
    first = initial_network((2, 3, 1), 4, 1)
    again, other, seeded = (initial_network((2, 3, 1), seed, stream) for seed, stream in ((4, 1), (4, 2), (5, 1)))
    assert torch.equal(first.weights[0], again.weights[0])
    assert not torch.equal(first.weights[0], other.weights[0])
    assert not torch.equal(first.weights[0], seeded.weights[0])
    orders = {tuple(torch.randperm(20, generator=batch_order(*key)).tolist()) for key in ((4, 1), (4, 2), (5, 1))}
    assert len(orders) == 3


def test_a_network_that_learns_classes_is_a_gate():
    network, report = GATE.train(progress=False)
    right = (network(torch.from_numpy(X[50:])).argmax(dim=1).numpy() == (X[50:, 0] > 0)).mean()
    assert report.accuracy == pytest.approx(right)
    assert report.accuracy > 0.8
    assert REGRESSOR.train(progress=False)[1].accuracy is None


@pytest.mark.parametrize(("part", "steps"), [(GATE, 3), (REGRESSOR, 5)])
def test_gates_and_regressors_have_minibatches_of_their_own(part, steps, monkeypatch):
    """50 training samples are 3 batches of up to 20 or 5 batches of 10."""
    taken, step = [], torch.optim.Adam.step
    monkeypatch.setattr(torch.optim.Adam, "step", lambda self: (taken.append(self), step(self)))
    dataclasses.replace(part, settings=dataclasses.replace(SETTINGS, epochs=1)).train(progress=False)
    assert len(taken) == steps


def test_parts_come_back_in_order_whatever_the_order_they_are_trained_in():
    wide = dataclasses.replace(REGRESSOR, name="expert 1", sizes=(2, 30, 2), stream=2)
    here = train_parts([GATE, REGRESSOR, wide])
    threads = torch.get_num_threads()
    with ThreadPoolExecutor(1) as executor:
        there = train_parts([GATE, REGRESSOR, wide], executor)
    torch.set_num_threads(threads)
    for (network, report), (other, other_report) in zip(here, there, strict=True):
        assert (report.name, network.sizes) == (other_report.name, other.sizes)
        for value, other_value in zip(network.parameters(), other.parameters(), strict=True):
            torch.testing.assert_close(value, other_value, rtol=0, atol=1e-6)
