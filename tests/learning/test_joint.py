from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from moe_policy.learning.clustering import cluster
from moe_policy.learning.joint import fit_mixture_jointly, retrain
from moe_policy.learning.settings import Annealing, TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners.networks import ARGMAX, Softmax
from tests.trainings import QUICK, equal, weights


def test_joint_training_keeps_weights_of_the_settled_phase(samples):
    planner = fit_mixture_jointly(samples, 2, settings=QUICK, annealing=Annealing(end=0.05, share=0.6))
    assert planner.report.part("mixture").best_epoch >= 9
    assert planner.mixing == ARGMAX
    assert planner.details["annealing"] == {"start": 1.0, "end": 0.05, "share": 0.6}


def test_joint_training_learns(samples):
    planner = fit_mixture_jointly(samples, 2, settings=TrainingSettings(epochs=60))
    losses = planner.report.part("mixture").training_losses
    assert losses[-1] < losses[0] / 3


def test_retraining_with_argmax_leaves_the_gate(samples, pretrained):
    before = {key: value for key, value in weights(pretrained).items()}
    retrained = retrain(pretrained, samples, ARGMAX, settings=QUICK)
    assert equal(before, weights(pretrained))
    for key, value in weights(retrained).items():
        assert np.array_equal(value, before[key]) is key.startswith("gate"), key
    assert (retrained.name, retrained.mixing) == ("moe-retrained-argmax", ARGMAX)
    assert retrained.details["pretraining"]["clusters"]["method"] == "custom"


@pytest.mark.parametrize("epsilon", [1.0, 0.1])
def test_retraining_with_softmax_moves_the_gate(samples, pretrained, epsilon):
    retrained = retrain(pretrained, samples, Softmax(epsilon), settings=QUICK)
    assert not equal(retrained.network.gate.tensors(), pretrained.network.gate.tensors())
    assert (retrained.name, retrained.mixing) == (f"moe-retrained-softmax-{epsilon:g}", Softmax(epsilon))
    assert retrained.outputs is pretrained.outputs


def test_only_samples_of_its_own_problem_retrain_a_planner(samples, pretrained):
    other = dataclasses.replace(samples, problem=samples.problem.with_constants(mass=2.0))
    with pytest.raises(ValueError, match="of a variant of it"):
        retrain(pretrained, other, settings=QUICK)


def test_the_seed_decides_a_joint_training(samples):
    first, second, other = (fit_mixture_jointly(samples, 3, settings=QUICK, seed=seed) for seed in (1, 1, 2))
    assert equal(weights(first), weights(second))
    assert not equal(weights(first), weights(other))


def test_a_mixture_needs_an_expert(samples):
    with pytest.raises(ValueError, match="k: expected a whole number of at least 1, got 0"):
        fit_mixture_jointly(samples, 0, settings=QUICK)
    with pytest.raises(TypeError, match="k: expected a whole number"):
        fit_mixture_jointly(samples, 2.5, settings=QUICK)
    with pytest.raises(TypeError, match="annealing: expected Annealing"):
        fit_mixture_jointly(samples, 2, settings=QUICK, annealing=0.1)


@pytest.mark.parametrize("mixing", ["softmax", 0.1, Softmax])
def test_nothing_is_trained_with_an_unknown_mixing(samples, pretrained, mixing):
    for fit in (
        lambda: fit_mixture(samples, cluster(samples, "custom"), mixing=mixing),
        lambda: retrain(pretrained, samples, mixing),
        lambda: dataclasses.replace(pretrained, mixing=mixing),
    ):
        with pytest.raises(TypeError, match=r"expected Argmax(\(\))? or Softmax.*, got"):
            fit()


def test_only_a_mixture_can_be_retrained(samples):
    with pytest.raises(TypeError, match="single network"):
        retrain(fit_single(samples, settings=TrainingSettings(epochs=1)), samples)
