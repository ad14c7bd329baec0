from __future__ import annotations

import numpy as np
import pytest

from moe_policy.learning.settings import Annealing, TrainingSettings


@pytest.mark.parametrize(
    "arguments",
    [{"epochs": 0}, {"batch": 0}, {"patience": 0}, {"learning_rate": 0.0}, {"final_fraction": 0}, {"test_share": 1.0}],
)
def test_settings_are_checked(arguments):
    with pytest.raises(ValueError, match=next(iter(arguments))):
        TrainingSettings(**arguments)


def test_the_learning_rate_follows_half_a_cosine():
    settings = TrainingSettings(epochs=100, learning_rate=2.0, final_fraction=0.1)
    assert settings.rate(0) == pytest.approx(2.0)
    assert settings.rate(50) == pytest.approx(2.0 * 0.55)
    assert settings.rate(100) == pytest.approx(0.2)


def test_the_learning_rate_of_the_paper_is_constant():
    paper = TrainingSettings.paper()
    assert paper.rate(0) == paper.rate(700) == 1e-3
    assert (paper.epochs, paper.patience, paper.batch, paper.gate_batch) == (1500, 8, 64, 256)


def test_epsilon_falls_geometrically_and_then_stays():
    annealing = Annealing(start=1.0, end=0.01, share=0.8)
    epsilon = np.array([annealing.epsilon(epoch, 100) for epoch in range(100)])
    assert epsilon[0] == 1.0
    np.testing.assert_allclose(epsilon[80:], 0.01)
    np.testing.assert_allclose(epsilon[1:81] / epsilon[:80], 0.01 ** (1 / 80))


@pytest.mark.parametrize(
    ("arguments", "match"), [({"start": 0.1, "end": 1.0}, "end ≤ start"), ({"share": 1.0}, r"\[0, 1\)")]
)
def test_annealing_is_checked(arguments, match):
    with pytest.raises(ValueError, match=match):
        Annealing(**arguments)
