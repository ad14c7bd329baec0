from __future__ import annotations

import numpy as np
import pytest

from moe_policy.learning import recipes
from moe_policy.learning.clustering import Labels
from moe_policy.learning.recipes import FORMS, PRINCIPAL_COMPONENTS, make
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.networks import ARGMAX, MixtureOfExperts, SingleNetwork, Softmax
from tests.synthetic import FakeDatabase, beyond_borders, fake_samples, flights
from tests.trainings import equal, weights

QUICK = TrainingSettings(epochs=3)
SAMPLES = fake_samples(count=150, modes=3)


@pytest.mark.parametrize(
    ("name", "experts", "mixing"),
    [
        ("moe-custom", 3, ARGMAX),
        ("moe-kmeans-2", 2, ARGMAX),
        ("moe-kmeans-pca-4", 4, ARGMAX),
        ("moe-random", 3, ARGMAX),
        ("moe-retrained-argmax", 3, ARGMAX),
        ("moe-retrained-softmax-1", 3, Softmax(1.0)),
        ("moe-retrained-softmax-0.1", 3, Softmax(0.1)),
    ],
)
def test_names_of_mixtures_say_what_is_made(name, experts, mixing):
    planner = make(name, FakeDatabase(SAMPLES), settings=QUICK)
    assert planner.name == name
    assert isinstance(planner.network, MixtureOfExperts)
    assert len(planner.network.experts) == experts
    assert planner.mixing == mixing
    assert planner(SAMPLES.parameters).finite.all()


def test_the_clusters_are_those_of_the_name():
    clusters = {k: make(k, SAMPLES, settings=QUICK).details["clusters"] for k in ("moe-custom", "moe-kmeans-pca-3")}
    assert clusters["moe-custom"]["sizes"] == np.bincount(SAMPLES.mode).tolist()
    assert clusters["moe-kmeans-pca-3"]["settings"]["k"] == 3
    assert clusters["moe-kmeans-pca-3"]["settings"]["components"] == PRINCIPAL_COMPONENTS


def test_the_families_of_moe_auto_are_those_that_continuation_finds(monkeypatch, tmp_path):
    asked = []

    def found(samples, method, *, k, kept, executor):
        asked.append((method, k, kept))
        return Labels(SAMPLES.mode, ("family 0", "family 1", "family 2"), method)

    monkeypatch.setattr(recipes, "cluster", found)
    monkeypatch.setattr(recipes, "beyond", lambda samples, families: beyond_borders(samples, families, [5, 9]))
    planners = [make(name, SAMPLES, settings=QUICK, kept=tmp_path) for name in ("moe-auto", "moe-auto-3")]
    assert asked == [("continuation", None, tmp_path), ("continuation", 3, tmp_path)]
    assert [planner.name for planner in planners] == ["moe-auto", "moe-auto-3"]
    assert planners[0].details["clusters"]["method"] == "continuation"
    assert sum(planners[0].details["clusters"]["beyond"]) == 2


def test_where_continuation_finds_one_family_moe_auto_is_the_single_network(monkeypatch):
    one = Labels(np.zeros(len(SAMPLES), dtype=int), ("family 0",), "continuation")
    monkeypatch.setattr(recipes, "cluster", lambda *_, **__: one)
    auto, single = (make(name, SAMPLES, settings=QUICK) for name in ("moe-auto", "snn"))
    assert auto.name == "moe-auto"
    np.testing.assert_array_equal(auto(SAMPLES.parameters).flat(), single(SAMPLES.parameters).flat())


def test_one_family_round_path_constraints_is_split_by_their_sides(monkeypatch):
    samples = flights(40)
    one = Labels(np.zeros(len(samples), dtype=int), ("family 0",), "continuation")
    sides = Labels(np.arange(2 * len(samples)) % 2, ("side 0", "side 1"), "reaction")  # with their images
    monkeypatch.setattr(recipes, "cluster", lambda _, method, **__: {"continuation": one, "reaction": sides}[method])
    auto, by_sides = (
        make(name, samples, settings=TrainingSettings(epochs=2)) for name in ("moe-auto", "moe-reaction-2")
    )
    assert (auto.name, by_sides.name) == ("moe-auto", "moe-reaction-2")
    assert auto.details["clusters"]["together"] == recipes.TOGETHER
    assert equal(weights(auto), weights(by_sides))


def test_joint_training_knows_no_clusters_and_retraining_begins_with_the_custom_mixture():
    assert "clusters" not in make("moe-random", SAMPLES, settings=QUICK).details
    retrained = make("moe-retrained-argmax", SAMPLES, settings=QUICK, seed=4)
    custom = make("moe-custom", SAMPLES, settings=QUICK, seed=4)
    assert retrained.details["pretraining"]["clusters"] == custom.details["clusters"]
    # argmax leaves the gate as it was
    np.testing.assert_array_equal(retrained.gate(SAMPLES.parameters)[1], custom.gate(SAMPLES.parameters)[1])


def test_the_single_network_and_the_nearest_solution():
    assert isinstance(make("snn", SAMPLES, settings=QUICK).network, SingleNetwork)
    nearest = make("nearest", SAMPLES)
    assert isinstance(nearest, NearestPlanner)
    np.testing.assert_array_equal(nearest(SAMPLES.parameters).flat(), SAMPLES.trajectory.flat())


def test_settings_and_seed_reach_the_training():
    plans = [make("snn", SAMPLES, settings=QUICK, seed=seed)(SAMPLES.parameters[:5]).flat() for seed in (1, 1, 2)]
    np.testing.assert_array_equal(plans[0], plans[1])
    assert np.abs(plans[0] - plans[2]).max() > 1e-3
    for name in ("snn", "moe-custom", "moe-random"):
        report = make(name, SAMPLES, settings=QUICK).report
        assert {part.epochs for part in report.parts} == {3}


@pytest.mark.parametrize(
    "name", ["", "moe", "moe-kmeans", "moe-kmeans-x", "moe-retrained", "moe-retrained-softmax-", "SNN", "snn ", "sac"]
)
def test_other_names_are_refused_with_the_known_forms(name):
    with pytest.raises(ValueError, match="no recipe for") as caught:
        make(name, SAMPLES, settings=QUICK)
    assert all(form in str(caught.value) for form in FORMS)
