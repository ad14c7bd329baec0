"""Who takes part, and optimal trajectories that are kept."""

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.experiments import methods
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.symmetric import Symmetrised
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE


def test_the_shipped_ones_come_in_the_studys_order():
    names = [method.name for method in methods.shipped(PENDULUM)]
    assert names[:4] == ["nearest", "snn", "moe-custom", "moe-kmeans-4"]
    assert "sac" in names
    assert all(method.data for method in methods.shipped(PENDULUM))


def test_only_goals_that_can_be_held_have_a_stabiliser():
    assert [c.name for c in methods.stabiliser(PENDULUM)] == ["stabiliser"]
    assert methods.stabiliser(ocp_envs.load("GroundVehicle-v0")) == []


def test_networks_once_more_used_with_care():
    shipped = methods.shipped(QUADCOPTER_OBSTACLE)
    careful = methods.variants(QUADCOPTER_OBSTACLE, shipped)
    networks = [c.name for c in shipped if c.name == "snn" or c.name.startswith("moe-")]
    ways = {"half turn": Symmetrised, "radius + 0.1": WithMargin}
    assert [c.name for c in careful] == [f"{name}, {way}" for way in ways for name in networks]
    assert all(isinstance(c.actor, ways[c.name.split(", ")[1]]) for c in careful)
    assert methods.variants(PENDULUM, methods.shipped(PENDULUM)) == []


@pytest.fixture
def counted(monkeypatch):
    """Solves shares by the nearest neighbour, and counts them."""
    calls = []

    class Solver:
        def best(self, p):
            calls.append(len(p))
            return moe_policy.load(PENDULUM.id, "nearest")(p), p[:, 0] + 1

    monkeypatch.setattr(methods, "optimal_planner", lambda problem, nearest, guessers, solver: Solver())
    return calls


def test_kept_optima_are_not_solved_again(counted, monkeypatch, tmp_path):
    monkeypatch.setattr(methods, "SHARE", 4)
    p = ocp_envs.sample(PENDULUM, 0, 10)
    plans, costs = methods.solve_all(PENDULUM, p, keep=tmp_path)
    assert sorted(counted) == [2, 4, 4]
    again, same = methods.solve_all(PENDULUM, p, keep=tmp_path)
    assert len(counted) == 3
    np.testing.assert_array_equal(again.flat(), plans.flat())
    np.testing.assert_array_equal(same, costs)
    methods.solve_all(PENDULUM, p + 1e-9, keep=tmp_path)  # other parameters
    assert len(counted) == 6


def test_what_costs_more_than_the_reference_is_solved_from_the_experts_too(monkeypatch, tmp_path):
    calls = []

    class Solver:
        def __init__(self, guessers):
            self.cost = 1.0 if guessers else 2.0

        def best(self, p):
            calls.append((self.cost, len(p)))
            return moe_policy.load(PENDULUM.id, "nearest")(p), np.full(len(p), self.cost)

    monkeypatch.setattr(methods, "optimal_planner", lambda problem, nearest, guessers, solver: Solver(guessers))
    p, reference = ocp_envs.sample(PENDULUM, 0, 3), np.array([2.0, 1.0, 1.9999])
    for _ in range(2):  # what is kept is not solved again
        _, costs = methods.solve_all(PENDULUM, p, keep=tmp_path, reference=reference)
        np.testing.assert_array_equal(costs, [2.0, 1.0, 2.0])
    assert calls == [(2.0, 3), (1.0, 1)]


def test_damaged_files_are_solved_again(counted, tmp_path):
    p = ocp_envs.sample(PENDULUM, 0, 3)
    methods.solve_all(PENDULUM, p, keep=tmp_path)
    (file,) = tmp_path.glob("*.npz")
    file.write_bytes(file.read_bytes()[:100])
    methods.solve_all(PENDULUM, p, keep=tmp_path)
    methods.solve_all(PENDULUM, p)  # keeps nothing
    assert len(counted) == 3
    assert len(list(tmp_path.iterdir())) == 1
