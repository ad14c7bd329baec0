"""Optima with closed forms, one for each kind of goal, cost, constraint and duration that can be declared."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ocp_envs
from ocp_envs import FREE, Between, Box, Coordinate, Goal, OptimalControlProblem
from tests.small_problems import DOUBLE_INTEGRATOR

pytestmark = pytest.mark.usefixtures("interpreted")
STRONG = dataclasses.replace(DOUBLE_INTEGRATOR.system, control=Box((Coordinate("u", -5.0, 5.0, "N"),)))
START = Coordinate("x", -5.0, 5.0, "m")


def problem(**changes: Any) -> OptimalControlProblem:
    """A double integrator to the origin in the least time, from rest, with 41 knots and ``changes``."""
    fields: dict[str, Any] = {
        "id": "KnownAnswer-v0",
        "title": "move a mass",
        "system": DOUBLE_INTEGRATOR.system,
        "parameters": Box((START,)),
        "cost_rate": lambda x, u, s, c: 1,
        "goal": Goal([0, 0], radius=0.05),
        "duration": (0.2, 12.0),
        "knots": 41,
        "substeps": 1,
        "hold": 0.0,
        "time_limit": 15.0,
        "rest": [0.0, 0.0],
    }
    return OptimalControlProblem(**{**fields, **changes})


def least_energy(**changes: Any) -> OptimalControlProblem:
    """The same with ∫ u²/2 and a wide box of controls, in 5 s, with ``changes``."""
    fields = {"system": STRONG, "cost_rate": lambda x, u, s, c: u[0] ** 2 / 2, "duration": (5.0, 5.0)}
    return problem(**{**fields, "time_limit": 5.0, **changes})


def riccati(terminal: np.ndarray, seconds: float) -> np.ndarray:
    """The cost-to-go matrix of ∫ u²/2 + x'Sx/2 at the end, ``seconds`` before the end, of the double integrator."""
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])

    def rate(t: float, flat: np.ndarray) -> np.ndarray:
        s = flat.reshape(2, 2)
        return np.asarray(a.T @ s + s @ a - s @ b @ b.T @ s).ravel()

    end = solve_ivp(rate, (0.0, seconds), terminal.ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
    return np.asarray(end.reshape(2, 2))


def to_the_nearer(distances: tuple[float, float]) -> float:
    return 2 * np.sqrt(min(distances))


RIGHT = Coordinate("end", -5.0, 5.0, "m")
CASES = {
    "least time": (problem(), [4.0], 4.0),
    "least energy in a fixed time": (least_energy(), [4.0], 6 * 16 / 125),
    "one final value is free": (least_energy(goal=Goal([0, FREE])), [4.0], 1.5 * 16 / 125),
    "one final value is in a range": (least_energy(goal=Goal([Between(-3.0, 1.0), 0])), [4.0], 6 * 9 / 125),
    "a terminal cost": (
        least_energy(goal=Goal([FREE, FREE]), terminal_cost=lambda x, s, c: 5 * x[0] ** 2 + x[1] ** 2),
        [4.0],
        8 * riccati(np.diag([10.0, 2.0]), 5.0)[0, 0],
    ),
    "a terminal cost alone": (
        problem(
            goal=Goal([FREE, FREE]),
            cost_rate=None,
            terminal_cost=lambda x, s, c: -x[0],
            duration=(2.0, 2.0),
            rest=[0, 0],
        ),
        [-1.0],
        -1.0,
    ),
    "bounds of the control in p": (
        problem(
            parameters=Box((START, Coordinate("limit", 0.2, 1.0, "N"))),
            inequalities=lambda x, u, s, c: [s.limit - u[0], s.limit + u[0]],
        ),
        [4.0, 0.5],
        2 * np.sqrt(8),
    ),
    "a goal in p": (
        problem(parameters=Box((START, RIGHT)), goal=Goal(lambda s, c: [s.end, 0], radius=0.05)),
        [1.0, -3.0],
        4.0,
    ),
    "alternative goals": (problem(goal=Goal([[-5.0, 0], [3.0, 0]])), [1.5], to_the_nearer((6.5, 1.5))),
    "a duration in p": (
        least_energy(
            parameters=Box((START, Coordinate("seconds", 3.0, 5.0, "s"))), duration=(lambda s, c: s.seconds,) * 2
        ),
        [4.0, 4.0],
        6 * 16 / 64,
    ),
    "narrower bounds in plans": (problem(planned={"u": (-0.5, 0.5)}), [4.0], 2 * np.sqrt(8)),
    "a bound of a state in plans": (problem(planned={"v": (-1.0, 1.0)}), [4.0], 5.0),
    "initial values in p": (
        problem(parameters=Box((RIGHT,)), rest=lambda s, c: [2 * s.end, 0]),
        [2.0],
        4.0,
    ),
    "a final equality": (
        problem(goal=Goal([FREE, FREE], equalities=lambda x, s, c: [x[0] - 1], inequalities=lambda x, s, c: [-x[1]])),
        [3.0],
        2.0,
    ),
}


def _tripled() -> OptimalControlProblem:
    """Two forces of which the one is three times the other; the second has a bound of its own."""
    box = Box((Coordinate("u", -1.0, 1.0, "N"), Coordinate("w", -9.0, 9.0, "N")))
    system = dataclasses.replace(STRONG, control=box, dynamics=lambda x, u, c: [x[1], (u[0] + u[1]) / c.mass])
    return problem(system=system, equalities=lambda x, u, s, c: [u[1] - 3 * u[0]])


CASES["an equality of controls"] = (_tripled(), [4.0], 2.0)


@pytest.mark.parametrize("name", CASES)
def test_the_optimum_is_the_known_one(name):
    declared, p, cost = CASES[name]
    solution = ocp_envs.solve(declared, p, starts=2)
    assert solution.status == ocp_envs.Status.SOLVED, solution.reason
    assert solution.cost == pytest.approx(cost, rel=2e-3)
    _, contexts = declared.start(np.array([p]))
    assert declared.goal_error(solution.trajectory.states[:, -1], contexts) < 1e-3


@pytest.mark.parametrize("name", CASES)
def test_the_environment_reaches_the_goal_with_the_plan(name):
    """The plan's controls, applied for its intervals, lead into the goal ball, at the plan's cost."""
    declared, p, _ = CASES[name]
    solution = ocp_envs.solve(declared, p, starts=2)
    plan = solution.trajectory
    env = ocp_envs.Env(declared, dt=float(plan.step[0]), terminate_at_goal=declared.horizon.fixed)
    env.reset(options={"parameters": p})
    reward, info = 0.0, {}
    for control in plan.controls[0]:
        _, step, _, _, info = env.step(control)
        reward += step
    assert info["is_success"]
    assert -reward == pytest.approx(solution.cost, rel=1e-4, abs=1e-4)


def test_a_fixed_time_ends_no_episode_early():
    """Beginning at the goal, the episode lasts as long as the duration says."""
    declared, *_ = CASES["least energy in a fixed time"]
    env = ocp_envs.Env(declared, dt=0.5)
    _, info = env.reset(options={"parameters": [0.0]})
    steps, terminated = 0, False
    while not terminated:
        assert not info["is_success"]
        _, _, terminated, truncated, info = env.step([0.0])
        steps += 1
        assert not truncated
    assert (steps, info["is_success"]) == (10, True)


def test_problems_that_differ_in_what_they_declare_have_different_fingerprints():
    found = [declared.fingerprint for declared, *_ in CASES.values()]
    again = [dataclasses.replace(declared).fingerprint for declared, *_ in CASES.values()]
    assert len(set(found)) == len(found)
    assert found == again


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal": Goal([0, FREE]), "hold": 1.0}, r"the final values of \['v'\] are not fixed; declare hold=0.0"),
        ({"goal": Goal([0, FREE]), "rest": None}, r"does not fix where \['v'\] begin"),
        ({"goal": Goal([0, Between(2.0, 1.0)])}, "expected lower ≤ upper for v"),
        ({"goal": Goal([0, FREE, 0])}, r"a final value for each of \['x', 'v'\], got 3"),
        ({"goal": Goal(lambda s, c: [s.fin, 0])}, "no context coordinate 'fin'"),
        ({"cost_rate": None}, "expected a cost_rate, a terminal_cost or both"),
        ({"planned": {"w": (0, 1)}}, "'w', which is neither a state nor a control"),
        ({"planned": {"u": (-2.0, 1.0)}}, r"within \[-1, 1\] N"),
        ({"inequalities": lambda x, u, s, c: u[0]}, "inequalities must return a list"),
        ({"terminal_cost": lambda x, s, c: [x[0]]}, "terminal_cost must return one expression"),
    ],
)
def test_declarations_that_do_not_fit_are_refused(changes, message):
    with pytest.raises((ValueError, TypeError), match=message):
        problem(**changes)


def _over_a_peak(points):
    """Over a peak of the height 1 at x = 0, of the width of an interval, from the left to the right."""
    box = Box((Coordinate("x", -5.0, 5.0, "m"), Coordinate("y", -5.0, 5.0, "m")))
    system = dataclasses.replace(
        STRONG,
        state=box,
        control=Box((Coordinate("u", -1.0, 1.0, "m/s"), Coordinate("w", -5.0, 5.0, "m/s"))),
        constants={},
        dynamics=lambda x, u, c: [u[0], u[1]],
    )
    return problem(
        system=system,
        parameters=Box((Coordinate("x", -5.0, -3.0, "m"),)),
        cost_rate=lambda x, u, s, c: 1 + u[1] ** 2 / 2,
        goal=Goal([4.0, 0.0], radius=0.05),
        knots=8,
        clearance=lambda x, s, c: [x[1] - 2 + 4 * x[0] ** 2],
        clearance_points=points,
    )


@pytest.mark.parametrize("points", [2, 4])
def test_plans_keep_clear_between_knots_where_they_are_asked_to(points):
    """With the constraint at the knots alone, the plan passes through the peak."""
    fraction = np.linspace(0, 1, 101)[:, None]

    def deepest(declared):
        plan = ocp_envs.solve(declared, [-4.0], starts=4).trajectory
        states = np.concatenate([a + fraction * (b - a) for a, b in itertools.pairwise(plan.states[0])])
        return max(0.0, -float(declared.functions.clearances()(states, np.zeros((len(states), 0)))[0].min()))

    at_knots, between = deepest(_over_a_peak(1)), deepest(_over_a_peak(points))
    assert at_knots > 0.5
    assert between < 0.6 * at_knots


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("least time", "within 0.05 of the goal (x = 0, v = 0) or outside"),
        ("one final value is free", "within 1 of the goal (x = 0) at the given time or outside"),
        ("one final value is in a range", "(−3 ≤ x ≤ 1, v = 0)"),
        ("alternative goals", "(x = −5, v = 0, or x = 3, v = 0)"),
        ("a goal in p", "(x = 0, v = 0 in the middle of the box, a function of the context)"),
        ("a final equality", "(any state, with 2 final constraints)"),
        ("a terminal cost alone", "Minus 0, and minus φ at the end of the episode."),
    ],
)
def test_what_was_declared_is_described(name, text):
    assert text in ocp_envs.describe(CASES[name][0])


def test_a_terminal_cost_need_not_be_finite_where_trajectories_begin():
    """The mean power over the time, which is 0 / 0 at the beginning."""
    box = Box((*STRONG.state.coordinates, Coordinate("t", 0.0, 20.0, "s"), Coordinate("energy", 0.0, 50.0, "J")))
    system = dataclasses.replace(STRONG, state=box, dynamics=lambda x, u, c: [x[1], u[0] / c.mass, 1, u[0] ** 2])
    mean = problem(
        system=system,
        cost_rate=None,
        terminal_cost=lambda x, s, c: x[3] / x[2],
        goal=Goal([0, 0, FREE, FREE]),
        duration=(5.0, 5.0),
        rest=[0.0] * 4,
    )
    assert ocp_envs.solve(mean, [4.0], starts=1).cost == pytest.approx(12 * 16 / 125 / 5, rel=2e-3)
