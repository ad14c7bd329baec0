"""The global settings of PyTorch belong to the program, and make no difference to plans and weights."""

from __future__ import annotations

import contextlib
import dataclasses
import functools

import numpy as np
import pytest
import torch

import moe_policy
from moe_policy.learning.clustering import cluster
from moe_policy.learning.joint import retrain
from moe_policy.learning.training import fit_mixture
from moe_policy.planners.networks import Softmax
from ocp_envs.problems.pendulum import PENDULUM
from tests.synthetic import fake_samples
from tests.trainings import QUICK, equal, weights

P = PENDULUM.parameters.draw(np.random.default_rng(0), 50)
NAMES = ("snn", "moe-custom", "moe-retrained-softmax-1")
PLANS = {name: moe_policy.load(PENDULUM, name)(P).flat() for name in NAMES}


@contextlib.contextmanager
def default_dtype(dtype):
    torch.set_default_dtype(dtype)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


SETTINGS = {
    "double precision": lambda: default_dtype(torch.float64),
    "half precision": lambda: default_dtype(torch.bfloat16),
    "another device": lambda: torch.device("meta"),
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "no gradients": torch.no_grad,
    "inference": torch.inference_mode,
}
under_all_settings = pytest.mark.parametrize("setting", SETTINGS)


@under_all_settings
@pytest.mark.parametrize("name", NAMES)
def test_plans_do_not_depend_on_global_settings(setting, name):
    before = moe_policy.load(PENDULUM, name)
    with SETTINGS[setting]():
        for planner in (before, moe_policy.load(PENDULUM, name)):
            np.testing.assert_array_equal(planner(P).flat(), PLANS[name])
            if name != "snn":
                planner.gate(P)
                planner.experts(P)


@under_all_settings
def test_learned_policies_do_not_depend_on_global_settings(setting):
    observation = np.array([[0.5, 0.1], [3.0, -1.0]])
    wanted = moe_policy.load(PENDULUM, "sac").predict(observation)[0]
    with SETTINGS[setting]():
        np.testing.assert_array_equal(moe_policy.load(PENDULUM, "sac").predict(observation)[0], wanted)


@functools.cache
def usual():
    return trained()


def trained():
    """A mixture that is trained, loaded from its weights, and retrained."""
    samples = fake_samples(count=60)
    quick = dataclasses.replace(QUICK, epochs=2)
    mixture = fit_mixture(samples, cluster(samples, "custom"), settings=quick)
    return mixture, retrain(mixture, samples, Softmax(0.5), settings=quick)


@under_all_settings
def test_trainings_do_not_depend_on_global_settings(setting):
    with SETTINGS[setting]():
        planners = trained()
    for planner, wanted in zip(planners, usual()):
        assert equal(weights(planner), weights(wanted))
        assert planner.report.test_error == wanted.report.test_error
        assert planner.report.parts[0].training_losses == wanted.report.parts[0].training_losses


def test_planners_loaded_for_inference_can_be_trained():
    with torch.inference_mode():
        loaded = moe_policy.load(PENDULUM, "moe-custom")
    retrain(loaded, fake_samples(count=60), Softmax(0.5), settings=dataclasses.replace(QUICK, epochs=1))
