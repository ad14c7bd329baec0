"""The methods of docs/methods, which are scored as examples: they plan."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import ocp_envs
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "methods"


def _module(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("problem", [PENDULUM, VEHICLE], ids=lambda problem: problem.id)
def test_neighbours_with_a_linear_correction_begin_nearer_to_the_initial_state(problem):
    knn = _module("knn").make(problem)
    p = ocp_envs.sample(problem, 0, 30)
    begin = problem.start(p)[0]
    ours, theirs = (np.abs(planner(p).states[:, 0] - begin).mean() for planner in (knn, knn.nearest))
    assert ours < theirs / 2


def test_a_flow_draws_plans(monkeypatch):
    flow = _module("flow")
    monkeypatch.setattr(flow, "STEPS", 3)
    best, p = flow.best(PENDULUM, seed=1), ocp_envs.sample(PENDULUM, 0, 4)
    plans = best(p)
    assert plans.finite.all()
    np.testing.assert_array_equal(plans.flat(), best(p).flat())
    best.draws = 1
    np.testing.assert_array_equal(best(p).flat(), best.draw(p, 1))
