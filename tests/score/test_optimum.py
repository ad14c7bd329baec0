"""Optimal trajectories that are kept, and tracked."""

from __future__ import annotations

import numpy as np
import pytest

import moe_policy
import ocp_envs
from moe_policy.score import optimum
from ocp_envs.problems.pendulum import PENDULUM


@pytest.fixture
def counted(monkeypatch):
    """Solves shares by the nearest neighbour, and counts them."""
    calls = []

    class Solver:
        def best(self, p):
            calls.append(len(p))
            return moe_policy.load(PENDULUM.id, "nearest")(p), p[:, 0] + 1

    monkeypatch.setattr(optimum, "optimal_planner", lambda problem, nearest, guessers, solver: Solver())
    return calls


def test_kept_optima_are_not_solved_again(counted, monkeypatch, tmp_path):
    monkeypatch.setattr(optimum, "SHARE", 4)
    p = ocp_envs.sample(PENDULUM, 0, 10)
    plans, costs = optimum.solve_all(PENDULUM, p, None, keep=tmp_path)
    assert sorted(counted) == [2, 4, 4]
    again, same = optimum.solve_all(PENDULUM, p, None, keep=tmp_path)
    assert len(counted) == 3
    np.testing.assert_array_equal(again.flat(), plans.flat())
    np.testing.assert_array_equal(same, costs)
    optimum.solve_all(PENDULUM, p + 1e-9, None, keep=tmp_path)  # other parameters
    assert len(counted) == 6


def test_what_costs_more_than_the_reference_is_solved_from_the_experts_too(monkeypatch, tmp_path):
    calls = []

    class Solver:
        def __init__(self, guessers):
            self.cost = 1.0 if guessers else 2.0

        def best(self, p):
            calls.append((self.cost, len(p)))
            return moe_policy.load(PENDULUM.id, "nearest")(p), np.full(len(p), self.cost)

    monkeypatch.setattr(optimum, "optimal_planner", lambda problem, nearest, guessers, solver: Solver(guessers))
    p, reference = ocp_envs.sample(PENDULUM, 0, 3), np.array([2.0, 1.0, 1.9999])
    for _ in range(2):  # what is kept is not solved again
        _, costs = optimum.solve_all(
            PENDULUM, p, *optimum.shipped_guesses(PENDULUM), keep=tmp_path, reference=reference
        )
        np.testing.assert_array_equal(costs, [2.0, 1.0, 2.0])
    assert calls == [(2.0, 3), (1.0, 1)]


def test_damaged_files_are_solved_again(counted, tmp_path):
    p = ocp_envs.sample(PENDULUM, 0, 3)
    optimum.solve_all(PENDULUM, p, None, keep=tmp_path)
    (file,) = tmp_path.glob("*.npz")
    file.write_bytes(file.read_bytes()[:100])
    optimum.solve_all(PENDULUM, p, None, keep=tmp_path)
    optimum.solve_all(PENDULUM, p, None)  # keeps nothing
    assert len(counted) == 3
    assert len(list(tmp_path.iterdir())) == 1
