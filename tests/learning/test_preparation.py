from __future__ import annotations

import numpy as np
import pytest

from moe_policy.learning.preparation import Prepared
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.networks import ARGMAX
from moe_policy.planners.scaling import Standardizer
from tests.synthetic import fake_samples

SETTINGS = TrainingSettings(epochs=2, test_share=0.25)


@pytest.fixture(scope="module")
def samples():
    return fake_samples(count=120, modes=3)


@pytest.fixture(scope="module")
def data(samples, tmp_path_factory):
    return Prepared.of(samples, SETTINGS, seed=1, checkpoints=tmp_path_factory.mktemp("folder"))


def test_samples_are_standardised_in_single_precision(samples, data):
    split = data.examples.split
    assert (len(split.training), len(split.test)) == (90, 30)
    for scaled, scaler, values in (
        (data.examples.x, data.inputs, samples.parameters),
        (data.examples.y, data.outputs, samples.trajectory.flat()),
    ):
        assert scaled.dtype == np.float32
        np.testing.assert_allclose(scaled, scaler.scale(values), atol=1e-5)
        assert np.abs(scaled[split.training].mean(axis=0)).max() < 1e-5


def test_given_scalers_are_kept(samples):
    scalers = Standardizer(np.zeros(2), np.ones(2)), Standardizer(np.zeros(75), np.full(75, 2.0))
    data = Prepared.of(samples, SETTINGS, seed=1, scalers=scalers)
    np.testing.assert_allclose(data.examples.x, samples.parameters, rtol=1e-6)
    np.testing.assert_allclose(data.examples.y, samples.trajectory.flat() / 2, rtol=1e-6, atol=1e-6)


def test_a_regressor_learns_the_rows_of_its_split_alone(samples, data):
    own = data.examples.split.within(samples.mode == 1)
    part = data.regressor("expert 1", (5,), 2, own)
    assert (part.name, part.sizes, part.stream, part.seed) == ("expert 1", (2, 5, 75), 2, 1)
    assert len(part.examples.x) == (samples.mode == 1).sum()
    np.testing.assert_array_equal(part.examples.y[part.examples.split.training], data.examples.y[own.training])
    assert part.checkpoint == data.checkpoints / "expert-1.pt"
    assert data.regressor("single", (5,), 1).examples.x is data.examples.x


def test_a_classifier_learns_the_classes_of_all_rows(samples, data):
    part = data.classifier("gate", (4,), 0, samples.mode, 3)
    assert part.sizes == (2, 4, 3)
    assert part.examples.classified
    np.testing.assert_array_equal(part.examples.y, samples.mode)


def test_the_planner_carries_the_record_of_its_training(samples, data):
    part = data.regressor("single", (5,), 1)
    network, report = part.train(progress=False)
    planner = data.planner("mine", network, ARGMAX, [report], clusters={"k": 1})
    assert planner.details["seed"] == 1
    assert planner.details["samples"] == 120
    assert planner.details["clusters"] == {"k": 1}
    assert planner.details["settings"]["test_share"] == 0.25
    assert planner.report.parts == (report,)
    assert planner.report.test_error == pytest.approx(report.test_loss, rel=1e-6)


def test_unusable_samples_are_refused(samples):
    with pytest.raises(ValueError, match="at least two samples"):
        Prepared.of(samples[:1], SETTINGS, seed=0)
