import dataclasses
from functools import partial

import numpy as np
import pytest

from ocp_envs.data import many
from ocp_envs.data.checkup import check
from ocp_envs.support.sharing import Loans
from ocp_envs.system import Box, Coordinate
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURNING, WALLED_INTEGRATOR

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture(autouse=True)
def _solves_here(interpreted, monkeypatch):
    monkeypatch.setattr(many, "lent_solvers", lambda problem: Loans(partial(Solver, problem), 1))


def found(problem, subject):
    """The findings about a subject."""
    return [(each.verdict, each.text) for each in check(problem, instances=3).findings if each.subject == subject]


def with_states(problem, *coordinates, **changes):
    system = dataclasses.replace(problem.system, state=Box(coordinates))
    return dataclasses.replace(problem, id="Changed-v0", system=system, **changes)


def test_of_a_sound_problem_all_is_well():
    checkup = check(TURNING, instances=3)
    assert checkup.well
    subjects = ["functions", "goal", "parameters", "solver", "between knots", "families", "bounds", "scales"]
    assert [each.subject for each in checkup.findings] == subjects
    assert str(checkup).splitlines()[1].startswith("ok    functions: values and derivatives are finite")
    assert len(checkup.optima) == 3
    assert repr(checkup) == "<Checkup of 'Turn-v0': 0 faults>"


def test_infeasible_instances_are_counted():
    ((verdict, text),) = found(WALLED_INTEGRATOR, "parameters")
    assert verdict == "look"
    assert "of 200 instances are infeasible before any solve" in text
    assert "clearance 0" in text


def test_what_is_not_solved_is_told_with_its_reason():
    hasty = dataclasses.replace(DOUBLE_INTEGRATOR, id="Hasty-v0", duration=(0.1, 0.3))
    ((verdict, text),) = found(hasty, "solver")
    assert verdict in ("look", "wrong")
    assert "instances are solved" in text
    assert "violates" in text


def test_optima_at_a_bound_of_the_states_are_told():
    narrow = with_states(DOUBLE_INTEGRATOR, Coordinate("x", -20.0, 20.0, "m"), Coordinate("v", -1.001, 1.001, "m/s"))
    ((verdict, text),) = found(narrow, "bounds")
    assert verdict == "look"
    assert "optima touch the bounds of v, beyond which an episode ends" in text


def test_a_scale_that_does_not_fit_is_told():
    far = with_states(
        DOUBLE_INTEGRATOR, Coordinate("x", -20.0, 20.0, "m", scale=1e-4), Coordinate("v", -10.0, 10.0, "m/s")
    )
    ((verdict, text),) = found(far, "scales")
    assert verdict == "look"
    assert "times its scale 0.0001; give it Coordinate(…, scale=" in text


def test_steps_that_are_too_few_are_told():
    def damped(x, u, c):
        return [x[1], (u[0] - 15 * x[1]) / c.mass]

    system = dataclasses.replace(DOUBLE_INTEGRATOR.system, dynamics=damped)
    near = Box((Coordinate("x", -0.1, 0.1, "m"), Coordinate("v", -1.0, 1.0, "m/s")))
    changes = {"system": system, "parameters": near, "duration": (1.9, 12.0), "hold": 0.0}
    problem = dataclasses.replace(DOUBLE_INTEGRATOR, id="Damped-v0", **changes)
    steps = found(problem, "between knots")
    assert "1 Runge-Kutta substeps are too few" in steps[0][1]
    assert found(problem, "goal") == [("well", "not held: success is evaluated at the plan's end (hold = 0)")]


def test_a_function_that_is_not_finite_somewhere_is_told():
    def root(x, u, s, c):
        return 1 + u[0] ** 2 / 2 + 1e-9 * (x[0] + 5.5) ** 0.5

    problem = dataclasses.replace(DOUBLE_INTEGRATOR, id="Root-v0", cost_rate=root)
    ((verdict, text),) = found(problem, "functions")
    assert verdict == "look"
    assert text.startswith("cost_rate or its derivative is not finite at ")


def test_families_without_a_trajectory_are_named():
    modes = dataclasses.replace(TURNING.modes, names=("right", "left", "never"))
    ((verdict, text),) = found(dataclasses.replace(TURNING, modes=modes), "families")
    assert verdict == "well"
    assert "no trajectory was found of ['never']" in text


def test_nothing_may_be_feasible():
    parameters = Box((Coordinate("x", -5.0, 5.0, "m"), Coordinate("wall", -0.05, 0.05, "m")))
    blocked = dataclasses.replace(WALLED_INTEGRATOR, id="Blocked-v0", parameters=parameters)
    assert found(blocked, "solver") == [("wrong", "no instance is feasible; move the parameter box or the constraints")]


def test_a_family_that_is_out_of_range_is_a_finding_and_no_error():
    def side(problem, p, trajectory, multipliers):
        return np.where(np.abs(trajectory.controls).max(axis=(1, 2)) > 1e-3, 5, 0)

    modes = dataclasses.replace(TURNING.modes, classify=side)
    ((verdict, text),) = found(dataclasses.replace(TURNING, modes=modes), "solver")
    assert verdict == "wrong"
    assert text.startswith("solving raises ValueError: Turn-v0")
