"""Distributions of the parameters, in samples and in resets."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import ocp_envs
from ocp_envs import Conditioned, Normal, Sampler, Table
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR

ROWS = np.array([[1.0, 0.5], [-2.0, 0.0], [4.0, -1.0]])
FAR = Conditioned(lambda p: np.abs(p[:, 0]) > 4, name="a distance of more than 4 m")
DISTRIBUTIONS = {
    "normal": Normal([0.0, 0.5], [2.0, 0.2]),
    "table": Table(ROWS),
    "conditioned": FAR,
    "sampler": Sampler(lambda rng: [rng.uniform(0, 1), 0.25]),
}


def with_distribution(distribution):
    return dataclasses.replace(DOUBLE_INTEGRATOR, distribution=distribution)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_the_ith_parameter_of_a_sample_depends_on_the_seed_and_i(name):
    problem = with_distribution(DISTRIBUTIONS[name])
    many = ocp_envs.sample(problem, seed=3, n=2100)
    np.testing.assert_array_equal(ocp_envs.sample(problem, seed=3, n=50), many[:50])
    assert problem.parameters.contains(many).all()
    assert len(np.unique(many, axis=0)) > 2


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_resets_draw_from_it(name):
    problem = with_distribution(DISTRIBUTIONS[name])
    envs = ocp_envs.VectorEnv(problem, 64)
    _, info = envs.reset(seed=0)
    p = info["parameters"]
    assert {
        "normal": abs(p[:, 1].mean() - 0.5) < 0.1,
        "table": {*map(tuple, p)} == {*map(tuple, ROWS)},
        "conditioned": (np.abs(p[:, 0]) > 4).all(),
        "sampler": (p[:, 1] == 0.25).all(),
    }[name]


def test_normal_parameters_have_their_mean_and_deviation():
    problem = with_distribution(Normal([0.0, 0.0], [0.5, 0.1]))
    p = ocp_envs.sample(problem, seed=0, n=4000)
    np.testing.assert_allclose(p.mean(axis=0), 0, atol=0.03)
    np.testing.assert_allclose(p.std(axis=0), [0.5, 0.1], rtol=0.05)


@pytest.mark.parametrize(
    ("distribution", "message"),
    [
        (lambda: Normal([0.0], [1.0]), r"a mean and a deviation for each of \['x', 'v'\]"),
        (lambda: Normal([0.0, 9.0], [1.0, 1.0]), r"the mean of \['v'\] lies more than three deviations outside"),
        (lambda: Normal([0.0, 0.0], [1.0, 0.0]), "deviation must be positive"),
        (lambda: Table([[9.0, 0.0]]), "outside the box"),
        (lambda: Table([]), "at least one row"),
        (lambda: Conditioned(lambda p: np.zeros(len(p), bool)), "none of 10000 draws was accepted"),
        (lambda: Sampler(lambda rng: [0.0]), r"must return parameters \(2,\), got the shape \(1,\)"),
        (lambda: Sampler(lambda rng: [9.0, 0.0]), "outside the box"),
    ],
)
def test_distributions_that_do_not_fit_are_refused(distribution, message):
    with pytest.raises(ValueError, match=message):
        with_distribution(distribution())


def test_they_are_described():
    text = ocp_envs.describe(with_distribution(FAR))
    assert "uniform on a distance of more than 4 m" in text


def test_states_on_the_way_lie_along_trajectories_and_beside_them():
    times = np.linspace(0, 1, DOUBLE_INTEGRATOR.knots)
    states = np.stack([4 - 4 * times, np.full_like(times, -1.0)], axis=1)[None]
    path = Trajectory(states, np.zeros((1, DOUBLE_INTEGRATOR.knots - 1, 1)), np.array([4.0]))
    for deviation, spread in (([0.0, 0.0], 0.0), ([0.0, 0.2], 0.2)):
        made = ocp_envs.OnTheWay(path, np.zeros((1, 0)), deviation)
        problem = dataclasses.replace(DOUBLE_INTEGRATOR.from_any_state, distribution=made)
        p = ocp_envs.sample(problem, seed=1, n=400)
        assert 0.0 <= p[:, 0].min() < 0.2 < 3.8 < p[:, 0].max() <= 4.0
        np.testing.assert_allclose(p[:, 1].std(), spread, atol=0.02)
    assert "on the way along 1 trajectories" in ocp_envs.describe(problem)


@pytest.mark.parametrize(
    ("contexts", "deviation", "message"),
    [
        (np.zeros((2, 0)), [0.1, 0.1], "with contexts"),
        (np.zeros((1, 0)), [0.1, -0.1], "must not be negative"),
        (np.zeros((1, 1)), [0.1, 0.1], "got \\(2, 1, 2\\)"),
        (np.zeros((1, 0)), [0.1], "got \\(2, 0, 1\\)"),
    ],
)
def test_states_on_the_way_fit_the_problem(contexts, deviation, message):
    path = Trajectory(np.zeros((1, 21, 2)), np.zeros((1, 20, 1)), np.ones(1))
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(DOUBLE_INTEGRATOR, distribution=ocp_envs.OnTheWay(path, contexts, deviation))
