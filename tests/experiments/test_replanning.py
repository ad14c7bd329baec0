"""The benchmark of plans that are renewed."""

import numpy as np
import pytest

import moe_policy
from moe_policy.experiments import disturbed, replanning
from moe_policy.rollouts.environments import environments
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.sampling import sample
from tests.closed_loop import vector
from tests.small_problems import DOUBLE_INTEGRATOR

P = np.array([[2.0, 0.0], [-1.0, 0.0]])


def test_pushes_come_at_their_step_and_a_wind_at_every_one():
    when, change = np.array([[1], [2]]), np.array([[[0.0, 0.5]], [[0.0, -0.5]]])
    envs = disturbed.Pushed(vector(DOUBLE_INTEGRATOR, 2), when, change, np.array([0.0, 0.1]))
    for _ in range(2):
        envs.reset(options={"parameters": P})
        speeds = []
        for _ in range(4):
            envs.step(np.zeros((2, 1)))
            speeds.append(envs.unwrapped.state[:, 1])
        np.testing.assert_allclose(np.transpose(speeds), [[0.1, 0.7, 0.8, 0.9], [0.1, 0.2, -0.2, -0.1]], atol=1e-12)


def test_pushes_are_drawn_by_seed_over_the_duration_of_the_plan():
    durations = np.array([1.0, 5.0, 3.0])
    (when, change), (again, same), (other, _) = (disturbed.pushes(VEHICLE, durations, 0.02, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(when, again)
    np.testing.assert_array_equal(change, same)
    assert (when != other).any()
    assert ((when >= 0) & (when * 0.02 <= durations[:, None])).all()
    assert (change[:, :, :2] == 0).all()
    assert (change[:, :, 2:] != 0).all()


@pytest.mark.parametrize(
    ("problem", "names"),
    [
        (PENDULUM, ["nominal", "pushes", "mass +10 %", "delay 60 ms"]),
        (VEHICLE, ["nominal", "pushes", "speed gain -20 %", "delay 60 ms"]),
        (QUADCOPTER, ["nominal", "pushes", "mass +10 %", "wind 1 m/s²"]),
        (DOUBLE_INTEGRATOR, ["nominal", "pushes", "mass +10 %", "delay 60 ms"]),
    ],
)
def test_conditions_fit_the_problem(problem, names):
    found = disturbed.conditions(problem)
    assert [condition.name for condition in found] == names
    for condition in found:
        environments(problem, 1, **condition.arguments)


def test_guesses_from_any_state_are_plans_of_the_nearest_parameters():
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), np.array([[1.0, 5.0]])
    guess = replanning.FromAnyState(planner)
    np.testing.assert_array_equal(guess(p).flat(), planner(np.array([[1.0, 2.0]])).flat())


def test_rows_say_how_methods_fare_under_each_condition(monkeypatch):
    def methods(problem, planner, optimal, every, condition):
        replanned = moe_policy.Replanning(planner, every, moe_policy.Renewal(iterations=0, rounds=0), problem=problem)
        return {"tracked": moe_policy.TrackingPolicy(problem, optimal), "replanned": replanned}

    monkeypatch.setattr(replanning, "methods", methods)
    planner, p = moe_policy.load(PENDULUM, "moe-custom"), sample(PENDULUM, 1, 3)
    rows = replanning.run_split(PENDULUM, "uniform", p, planner(p), planner, 0.4)
    assert len(rows) == 8
    assert [row.flips is None for row in rows] == [True, False] * 4
    assert rows[0].relative_cost == 1.0
    assert all(row.success.count == 3 for row in rows[:2])
    monkeypatch.setattr(replanning, "methods", lambda *a: {f"{planner.name}, replanned": methods(*a)["replanned"]})
    times = replanning.latency(PENDULUM, p, planner(p), planner, 0.4, 2)
    assert [each.condition for each in times] == ["nominal", "pushes"]
    assert all(0 < each.median <= each.percentile_99 for each in times)
