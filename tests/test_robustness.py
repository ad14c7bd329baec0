"""Perturbed plants: what the environment is told, and that no perturbation is the plain rollout."""

import dataclasses

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.comparison import Contestant, run
from moe_policy.robustness import PERTURBATIONS, Perturbation, perturbations_of, run_level
from moe_policy.robustness_figures import robustness_figure
from moe_policy.rollout import environments
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from tests.problems import DOUBLE_INTEGRATOR

STARTS = np.array([[0.5, 0.0], [3.0, 0.4], [5.0, -1.0], [6.0, 1.5]])


@pytest.fixture(scope="module")
def stabiliser():
    return [Contestant("stabiliser", moe_policy.Stabiliser(PENDULUM))]


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_every_level_makes_an_environment(problem):
    for perturbation in PERTURBATIONS[problem.id]:
        for level in perturbation.levels:
            envs = environments(problem, 1, 0.02, **perturbation.arguments(problem, level))
            settings = envs.unwrapped.settings
            changed = bool(settings.constants) or settings.disturbed or settings.noisy or settings.delay > 0
            assert changed == (level != 0)
            envs.close()


def test_a_heavier_plant_is_heavier():
    mass = perturbations_of(PENDULUM)[0]
    envs = environments(PENDULUM, 1, 0.02, **mass.arguments(PENDULUM, 0.3))
    assert envs.unwrapped.settings.simulator.problem.system.constants["mass"] == pytest.approx(1.3)
    assert envs.unwrapped.problem.system.constants["mass"] == 1.0


def test_only_the_velocity_is_disturbed_and_noise_follows_the_scales():
    by_name = {perturbation.name: perturbation for perturbation in perturbations_of(PENDULUM)}
    np.testing.assert_array_equal(by_name["disturbance"].arguments(PENDULUM, 0.5)["disturbance"], [0.0, 0.5])
    noise = by_name["noise"].arguments(PENDULUM, 0.1)["observation_noise"]
    np.testing.assert_allclose(noise, 0.1 * PENDULUM.system.state.scale)


def test_no_perturbation_is_the_plain_rollout(stabiliser):
    plain, _ = run(PENDULUM, stabiliser[0], STARTS, batches=())
    for perturbation in perturbations_of(PENDULUM):
        (row,) = run_level(PENDULUM, stabiliser, STARTS, perturbation, 0.0)
        assert row["success"] == plain["success"]
        assert row["reached"] == plain["reached"]


def test_the_seed_decides_the_noise(stabiliser):
    noise = next(p for p in perturbations_of(PENDULUM) if p.name == "disturbance")
    starts = ocp_envs.sample(PENDULUM, 3, 60)
    rows = [run_level(PENDULUM, stabiliser, starts, noise, 2.0, seed=seed)[0] for seed in (0, 0, 1)]
    assert rows[0] == rows[1]
    assert rows[0]["success"]["count"] < run_level(PENDULUM, stabiliser, starts, noise, 0.0)[0]["success"]["count"]


def test_a_weak_motor_cannot_swing_up(stabiliser):
    """At a tenth of the torque no pendulum gets up; the torque is what changes."""
    weak = Perturbation("torque", "torque", "mismatch", (-0.9, 0.0), ("torque_gain",))
    (row,) = run_level(PENDULUM, stabiliser, STARTS, weak, -0.9)
    assert row["reached"]["count"] < run_level(PENDULUM, stabiliser, STARTS, weak, 0.0)[0]["reached"]["count"]


def test_a_problem_of_ones_own_has_perturbations():
    names = {perturbation.name for perturbation in perturbations_of(DOUBLE_INTEGRATOR)}
    assert names == {*DOUBLE_INTEGRATOR.system.constants, "noise", "delay"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "magic"}, "expected a kind of"),
        ({"levels": (0.1, 0.2)}, "with 0 among them"),
        ({"levels": (0.0, 0.2, 0.1)}, "expected increasing levels"),
    ],
)
def test_bad_perturbations_are_refused(change, message):
    good = perturbations_of(PENDULUM)[0]
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(good, **change)


def test_unknown_constants_are_refused():
    with pytest.raises(ValueError, match=r"has no \['colour'\]"):
        Perturbation("colour", "colour", "mismatch", (0.0, 1.0), ("colour",)).arguments(PENDULUM, 1.0)


def test_the_figure_is_drawn(stabiliser, tmp_path):
    perturbations = perturbations_of(PENDULUM)[:2]
    rows = [
        row
        for p in perturbations
        for level in p.levels[::4]
        for row in run_level(PENDULUM, stabiliser, STARTS, p, level)
    ]
    assert robustness_figure(tmp_path / "r.png", rows, perturbations).stat().st_size > 1000
