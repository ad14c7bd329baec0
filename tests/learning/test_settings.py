from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from moe_policy.learning.settings import Annealing, TrainingSettings

#: Values that are refused, for each kind of argument.
NO_COUNT = (0, -1, 1.5, np.nan, True, "many", None, [3])
NO_NUMBER = (0.0, -1e-3, np.nan, np.inf, True, "small", None, [0.1])
NO_FRACTION = (*NO_NUMBER, 2.0)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("epochs", NO_COUNT),
        ("batch", NO_COUNT),
        ("gate_batch", NO_COUNT),
        ("patience", [value for value in NO_COUNT if value is not None]),
        ("learning_rate", NO_NUMBER),
        ("final_fraction", NO_FRACTION),
        ("test_share", (*NO_FRACTION, 1.0)),
    ],
)
def test_settings_are_checked(name, values):
    for value in values:
        with pytest.raises((ValueError, TypeError), match=name):
            TrainingSettings(**{name: value})


def test_settings_made_of_numpys_numbers_are_json():
    settings = TrainingSettings(epochs=np.int64(3), patience=np.int32(2), learning_rate=np.float32(0.5))
    assert json.loads(json.dumps(dataclasses.asdict(settings))) == dataclasses.asdict(
        TrainingSettings(epochs=3, patience=2, learning_rate=0.5)
    )


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
    ("arguments", "match"),
    [
        ({"start": 0.1, "end": 1.0}, "end ≤ start"),
        ({"share": 1.0}, r"\[0, 1\)"),
        ({"start": np.inf}, "start"),
        ({"end": "low"}, "end"),
        ({"share": np.nan}, "share"),
    ],
)
def test_annealing_is_checked(arguments, match):
    with pytest.raises((ValueError, TypeError), match=match):
        Annealing(**arguments)
