"""Figures by name: which a problem has, and that what they tell agrees with what they were drawn from."""

import dataclasses

import numpy as np
import pytest

import ocp_envs
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.figures import gallery
from moe_policy.experiments.figures.rise import follow, rise_parameters
from ocp_envs.problems import PAPER
from ocp_envs.solvers.solver import GuardedSolver


@pytest.mark.parametrize(
    ("env_id", "names"),
    [
        ("PendulumSwingup-v0", {"jump", "errors", "clusters"}),
        ("GroundVehicle-v0", {"samples", "interpolation", "histories", "errors"}),
        ("Quadcopter-v0", {"samples", "errors"}),
        ("QuadcopterObstacle-v0", {"samples", "errors", "around", "flip", "violations"}),
    ],
)
def test_figures_follow_from_the_problem(env_id, names):
    assert set(gallery.drawings(ocp_envs.load(env_id))) == names


def test_the_papers_figures_of_results_are_all_there():
    """Figure 2 is a sketch of the mixture."""
    drawn = {drawing.paper for problem in PAPER for drawing in gallery.drawings(problem).values()}
    assert {1, 3, 4, 5, 6, 7, 8, 9, 10, 11} <= drawn


@pytest.mark.slow
def test_a_family_is_followed_past_the_flip():
    problem = ocp_envs.load("QuadcopterObstacle-v0")
    rise = benchmark_of(problem).figures.rise
    p = rise_parameters(problem, dataclasses.replace(rise, count=6))
    with GuardedSolver(problem) as solver:
        plans, costs = follow(problem, solver, p)
    assert len(plans) == 6
    here = slice(None, 4)  # further up it may end, and the solver find the other one
    assert np.isfinite(costs[here]).all()
    assert (np.diff(costs[here]) > 0).all()  # a higher start is further away
    assert (plans.states[here, 8, 2] < p[here, 5]).all()  # below the centre of the sphere
