"""The optimum does not depend on the units of cost, state and time."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ocp_envs
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.system import Box
from tests.in_process import Solver
from tests.published import rocket
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
P = np.array([[3.0, 0.5]])


def solved(problem, p=P):
    first = guesses(problem, p, np.array([0]), np.random.default_rng(0), "line")
    solution = Solver(problem).solve(p, first, np.array([0]))
    assert solution.solved.all()
    return solution


def in_units(problem, cost=1.0, length=1.0, seconds=1.0):
    """``problem`` in other units: a cost of 1, a metre and a second are so many of the new ones."""

    def box(old, *factors):
        changed = [
            dataclasses.replace(c, lower=f * c.lower, upper=f * c.upper, scale=f * c.scale)
            for c, f in zip(old.coordinates, factors, strict=True)
        ]
        return Box(tuple(changed))

    speed, force = length / seconds, length / seconds**2
    system = dataclasses.replace(
        problem.system, state=box(problem.system.state, length, speed), control=box(problem.system.control, force)
    )
    rate, goal = problem.cost_rate, problem.goal
    return dataclasses.replace(
        problem,
        system=system,
        parameters=box(problem.parameters, length, speed),
        cost_rate=lambda x, u, s, c: cost / seconds * rate(x, [u[0] / force], s, c),
        goal=dataclasses.replace(goal, radius=goal.radius * min(length, speed)),
        duration=tuple(seconds * t for t in problem.duration),
        hold=seconds * problem.hold,
        time_limit=seconds * problem.time_limit,
        **({} if problem.longest_substep is None else {"longest_substep": seconds * problem.longest_substep}),
    )


USUAL = solved(DOUBLE_INTEGRATOR)
exponents = st.integers(-8, 8)


@settings(max_examples=12)
@given(cost=exponents, length=st.integers(-5, 5), seconds=st.integers(-3, 3))
def test_the_optimum_is_that_in_other_units(cost, length, seconds):
    units = {"cost": 10.0**cost, "length": 10.0**length, "seconds": 10.0**seconds}
    m, s = units["length"], units["seconds"]
    solution = solved(in_units(DOUBLE_INTEGRATOR, **units), P * [m, m / s])
    np.testing.assert_allclose(solution.cost, units["cost"] * USUAL.cost, rtol=1e-5)
    scaled = solution.trajectory.states / [m, m / s]
    np.testing.assert_allclose(scaled, USUAL.trajectory.states, atol=2e-3)
    np.testing.assert_allclose(solution.trajectory.duration / s, USUAL.trajectory.duration, rtol=1e-3)


def test_multipliers_are_in_units_of_the_cost():
    problem = dataclasses.replace(WALLED_INTEGRATOR, clearance=lambda x, s, c: [s.wall - x[1]])  # a limit of speed
    p, factor = np.array([[-5.0, 1.0]]), 1e-7
    usual = solved(problem, p)
    small = solved(dataclasses.replace(problem, cost_rate=lambda x, u, s, c: factor * (1 + u[0] ** 2 / 2)), p)
    assert usual.multipliers.max() > 0.01
    np.testing.assert_allclose(small.multipliers, factor * usual.multipliers, atol=1e-3 * factor)


def test_usual_costs_are_not_scaled():
    assert transcribe(DOUBLE_INTEGRATOR).cost_scale == 1.0
    tiny = dataclasses.replace(DOUBLE_INTEGRATOR, cost_rate=lambda x, u, s, c: 1e-6 * (1 + u[0] ** 2 / 2))
    assert transcribe(tiny).cost_scale == 1e-6


def test_the_scale_does_not_depend_on_how_strong_the_actuators_are():
    system = DOUBLE_INTEGRATOR.system
    strong = dataclasses.replace(
        system, control=Box((dataclasses.replace(system.control.coordinates[0], lower=-1e3, upper=1e3),))
    )
    assert transcribe(dataclasses.replace(DOUBLE_INTEGRATOR, system=strong)).cost_scale == 1.0


@pytest.mark.usefixtures("interpreted")
def test_a_constant_in_the_terminal_cost_changes_nothing():
    """The climb of Goddard's rocket is a hundredth of its height."""
    climb = rocket.PROBLEM
    height = dataclasses.replace(climb, terminal_cost=lambda x, s, c: -x[0])
    assert transcribe(height).cost_scale == transcribe(climb).cost_scale < 1
    costs = [ocp_envs.solve(problem, rocket.CASE.p, starts=1).cost for problem in (climb, height)]
    assert costs[1] + 1 == pytest.approx(costs[0], rel=1e-4)
