import numpy as np
import pytest

from moe_policy.experiments.borders import BORDER_COLUMNS, VARIANTS, BorderModel, BorderRow, Mixtures
from moe_policy.learning.clustering import cluster
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture
from moe_policy.reports.tables import markdown_table
from tests.synthetic import beyond_borders, fake_samples
from tests.trainings import equal, weights

SETTINGS = TrainingSettings(epochs=3)


@pytest.fixture(scope="module")
def mixtures():
    samples = fake_samples(200)
    labels = cluster(samples, "custom")
    return Mixtures(samples, labels, beyond_borders(samples, labels.values, np.arange(0, 200, 10)), SETTINGS)


@pytest.fixture(scope="module")
def planners(mixtures):
    return mixtures.planners(0)


def test_the_usual_mixture_is_that_of_the_usual_training(mixtures, planners):
    usual = fit_mixture(mixtures.samples, mixtures.labels, settings=SETTINGS)
    assert equal(weights(planners["own instances, classes"]), weights(usual))


def test_experts_and_gates_are_those_of_the_name(planners):
    parts = {name: weights(planners[name]) for name in VARIANTS}
    gates, experts = (
        {
            name: {key: value for key, value in found.items() if ("gate" in key) == of_gate}
            for name, found in parts.items()
        }
        for of_gate in (True, False)
    )
    own, beyond, regret, both = VARIANTS
    assert equal(gates[own], gates[beyond])
    assert equal(gates[regret], gates[both])
    assert not equal(gates[own], gates[regret])
    assert equal(experts[own], experts[regret])
    assert equal(experts[beyond], experts[both])
    assert not equal(experts[own], experts[beyond])


def test_a_row_has_the_median_and_range_over_the_seeds():
    models = [
        BorderModel(name="own instances, regret", seed=seed, at_plan_end={"uniform": 7 + seed}, test_error=0.5)
        for seed in range(3)
    ]
    row = BorderRow.of(models)
    assert BorderRow.from_json(row.to_json()) == row
    line = markdown_table([row], BORDER_COLUMNS).splitlines()[-1]
    assert line == "| own instances, regret | 8 (7–9) | 0.5000 (0.5000–0.5000) |"
