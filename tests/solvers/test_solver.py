import dataclasses
import os
import re
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ocp_envs.goal import Goal
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers import optimum, solver
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.guesses import NEAREST_WINDING, guesses
from ocp_envs.solvers.nlp import SolverSettings, Status
from ocp_envs.solvers.optimum import solve
from ocp_envs.solvers.reasons import not_finite
from ocp_envs.support.sharing import Loans
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.solvers.programs import DISC, box, line
from tests.threads import in_threads

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
IPOPT = SolverSettings(primary="ipopt")


# -- known answers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [SolverSettings(), IPOPT], ids=["fatrop", "ipopt"])
def test_minimum_time_and_energy_with_saturation(settings):
    """From (d, 0): u = clip(−3/2 (1 − 2t/T), ±1) with T² = 108 d / 23 and J = 23 T / 18, from Pontryagin's principle.

    The transcription holds its controls in 20 intervals, which costs O(h²).
    """
    distance = 4.0
    solution = Solver(DOUBLE_INTEGRATOR, settings).solve(*line(DOUBLE_INTEGRATOR, [distance, 0.0]))
    duration = np.sqrt(108 * distance / 23)
    assert solution.status[0] == Status.SOLVED
    assert solution.cost[0] == pytest.approx(23 * duration / 18, rel=2e-3)
    assert solution.cost[0] > 23 * duration / 18 - 1e-4
    assert solution.trajectory.duration[0] == pytest.approx(duration, rel=5e-3)
    middle = (np.arange(20) + 0.5) / 20
    expected = np.clip(-1.5 * (1 - 2 * middle), -1, 1)
    np.testing.assert_allclose(solution.trajectory.controls[0, :, 0], expected, atol=0.03)


@pytest.mark.parametrize("settings", [SolverSettings(), IPOPT], ids=["fatrop", "ipopt"])
@pytest.mark.parametrize("duration", [5.0, 6.0, 11.0])
def test_a_fixed_final_time(settings, duration):
    """From (2, 0): J = T + 6 d²/T³, from Pontryagin's principle, and up to 1/(N − 1)² for controls that are held."""
    fixed = dataclasses.replace(DOUBLE_INTEGRATOR, duration=(duration, duration))
    solution = Solver(fixed, settings).solve(*line(fixed, [2.0, 0.0]))
    assert solution.status[0] == Status.SOLVED
    assert solution.trajectory.duration[0] == pytest.approx(duration, rel=1e-12)
    work = 6 * 2.0**2 / duration**3
    # The goal is a box of ±1e-5, which is worth about 1e-5 of the cost.
    assert duration + work * (1 - 1e-4) - 1e-4 < solution.cost[0] < duration + work * (1 + 2 / 20**2)


def test_discrete_optimum_without_bounds():
    """For a fixed t_f the discrete problem is least squares: minimum-norm controls; t_f by line search."""
    wide = dataclasses.replace(
        DOUBLE_INTEGRATOR, system=dataclasses.replace(DOUBLE_INTEGRATOR.system, control=box(u=50.0))
    )
    start, m = np.array([3.0, -0.5]), DOUBLE_INTEGRATOR.knots - 1

    def optimum(duration):
        h = duration / m
        left = h * np.arange(m - 1, -1, -1)  # time left after each interval
        reach = np.stack([h**2 / 2 + h * left, np.full(m, h)])
        u = -np.linalg.pinv(reach) @ (np.array([[1, duration], [0, 1]]) @ start)
        return duration + h * (u**2).sum() / 2

    best = minimize_scalar(optimum, bounds=(0.2, 12.0), method="bounded", options={"xatol": 1e-10})
    solution = Solver(wide).solve(*line(wide, start))
    # The goal is a box of ±1e-5, which is worth about 1e-5 of the cost.
    assert solution.cost[0] == pytest.approx(best.fun, rel=1e-4)
    assert solution.trajectory.duration[0] == pytest.approx(best.x, rel=1e-4)


def test_multipliers_are_the_price_of_the_constraint():
    """Envelope theorem: dJ/d(radius) is the sum of the multipliers, since every clearance falls with the radius."""
    solver, p = Solver(DISC), np.array([[-3.0, 0.3, 1.0]])
    step = 1e-4
    costs = [solver.solve(*line(DISC, p + np.array([0, 0, d]))).cost[0] for d in (step, -step)]
    solution = solver.solve(*line(DISC, p))
    assert solution.status[0] == Status.SOLVED
    multipliers = solution.multipliers[0, :, 0]
    assert multipliers.shape == (DISC.knots,)
    assert (multipliers >= 0).all()
    assert multipliers.sum() == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-3)
    (clearance,) = DISC.functions.clearances()(solution.trajectory.states[0], np.full((DISC.knots, 1), 1.0))
    assert multipliers.sum() > 0.1
    assert np.abs(clearance[multipliers > 1e-3]).max() < 1e-4
    assert np.abs(multipliers[clearance[:, 0] > 1e-2]).max() < 1e-3


def test_mirror_about_the_bottom(pendulum):
    """θ → −θ, ω → −ω, u → −u maps the goal π to −π."""
    starts = np.array([[0.4, 0.7], [-0.4, -0.7]])
    solutions = pendulum.solve(
        *[_join(a, b) for a, b in zip(line(PENDULUM, starts[0], 1), line(PENDULUM, starts[1], 0))]
    )
    assert (solutions.status == Status.SOLVED).all()
    assert solutions.cost[0] == pytest.approx(solutions.cost[1], rel=1e-6)
    np.testing.assert_allclose(solutions.trajectory.states[0], -solutions.trajectory.states[1], atol=1e-4)


def test_reflection_about_upright(pendulum):
    """θ → 2π − θ, ω → −ω, u → −u maps the goal π to itself, and −π to 3π."""
    starts = np.array([[0.9, 1.1], [2 * np.pi - 0.9, -1.1]])
    for pair in ((1, 1), (0, 2), (2, 0)):
        both = [_join(a, b) for a, b in zip(line(PENDULUM, starts[0], pair[0]), line(PENDULUM, starts[1], pair[1]))]
        solutions = pendulum.solve(*both)
        assert (solutions.status == Status.SOLVED).all()
        assert solutions.cost[0] == pytest.approx(solutions.cost[1], rel=1e-6)


def _join(a, b):
    return Trajectory.concatenate([a, b]) if isinstance(a, Trajectory) else np.concatenate([a, b])


def test_both_solvers_agree(pendulum):
    rng = np.random.default_rng(3)
    p = PENDULUM.parameters.lower + rng.random((8, 2)) * [2 * np.pi, 4.0]
    arguments = line(PENDULUM, p, 1)
    first, second = pendulum.solve(*arguments), Solver(PENDULUM, IPOPT).solve(*arguments)
    both = first.solved & second.solved
    assert both.sum() >= 6
    both &= ~(first.fallback | second.fallback)
    assert both.sum() >= 5
    np.testing.assert_allclose(first.cost[both], second.cost[both], rtol=1e-6)
    np.testing.assert_allclose(first.trajectory.states[both], second.trajectory.states[both], atol=1e-4)


# -- batches, windings, failures -------------------------------------------------------------------------------------


def test_windings_are_reached_and_the_nearest_one_can_be_asked_for(pendulum):
    p = np.tile([[np.pi - 0.5, 0.0]], (3, 1))
    windings = np.arange(3)
    tried = guesses(PENDULUM, p, windings, np.random.default_rng(0), "line")
    given = pendulum.solve(p, tried, windings)
    assert (given.status == Status.SOLVED).all()
    np.testing.assert_allclose(given.trajectory.states[:, -1], PENDULUM.targets, atol=1e-4)
    np.testing.assert_array_equal(PENDULUM.modes.classify(PENDULUM, p, given.trajectory, given.multipliers), windings)
    np.testing.assert_array_equal(pendulum.solve(p, tried, np.full(3, NEAREST_WINDING)).cost, given.cost)


def test_a_solve_does_not_depend_on_what_was_solved_before(pendulum):
    p = np.array([[0.5, 0.1], [1.0, -1.0], [4.0, 1.5]])
    arguments = line(PENDULUM, p, 1)
    together = pendulum.solve(*arguments)
    for i in (2, 0, 1):
        alone = pendulum.solve(arguments[0][[i]], arguments[1][i], arguments[2][[i]])
        np.testing.assert_array_equal(alone.trajectory.flat()[0], together.trajectory.flat()[i])


def test_failure_is_a_value():
    """Nothing swings up within a second."""
    hurried = dataclasses.replace(PENDULUM, duration=(0.1, 1.0))
    solution = Solver(hurried).solve(*line(hurried, [0.0, 0.0], 1))
    assert solution.status[0] == Status.INFEASIBLE
    assert solution.cost[0] == np.inf
    assert np.isnan(solution.trajectory.flat()).all()


def test_empty_batch(pendulum):
    empty = np.empty((0, 2))
    plans = Trajectory(np.empty((0, 25, 2)), np.empty((0, 24, 1)), np.empty(0))
    assert len(pendulum.solve(empty, plans, np.empty(0, dtype=int))) == 0


def test_bad_arguments_say_what_is_wrong(pendulum):
    p, tried, windings = line(PENDULUM, [[0.5, 0.1]], 1)
    with pytest.raises(ValueError, match=r"windings must be -1 … 2, got 3"):
        pendulum.solve(p, tried, windings + 2)
    with pytest.raises(ValueError, match=r"expected guesses with states \(2, 25, 2\)"):
        pendulum.solve(np.repeat(p, 2, axis=0), tried, windings)
    with pytest.raises(ValueError, match="primary must be"):
        SolverSettings(primary="snopt")
    with pytest.raises(ValueError, match="kind must be"):
        guesses(PENDULUM, p, windings, np.random.default_rng(0), "spiral")


def test_a_guess_that_is_not_finite_is_a_failure_and_costs_the_others_nothing(pendulum):
    p, tried, windings = line(PENDULUM, [[0.5, 0.1]] * 3, 1)
    states = tried.states.copy()
    states[1, 7, 0] = np.nan
    found = pendulum.solve(p, dataclasses.replace(tried, states=states), windings)
    np.testing.assert_array_equal(found.status, [Status.SOLVED, Status.NOT_FINITE, Status.SOLVED])
    assert found.iterations[1] == 0
    np.testing.assert_array_equal(found.cost[[0, 2]], pendulum.solve(p, tried, windings).cost[[0, 2]])


# -- the best of one instance ----------------------------------------------------------------------------------------


def test_solve_finds_every_mode():
    solution = solve(PENDULUM, [np.pi - 0.5, 0.0], starts=2)
    assert solution.status == Status.SOLVED
    assert solution.mode == 1
    assert solution.cost == solution.modes.cost.min()
    assert (solution.modes.status == Status.SOLVED).all()
    np.testing.assert_allclose(solution.modes.trajectory.states[:, -1], PENDULUM.targets, atol=1e-4)
    assert verify(PENDULUM, solution.parameters[None], solution.trajectory).passed[0]


def test_the_optimum_does_not_depend_on_the_turn_in_which_angles_are_written():
    here, there = (solve(PENDULUM, [0.7 + turn, 0.3], starts=2) for turn in (0.0, 6 * np.pi))
    np.testing.assert_allclose(there.modes.cost, here.modes.cost, rtol=1e-9)
    assert there.mode == here.mode
    assert there.parameters.tolist() == [0.7 + 6 * np.pi, 0.3]
    moved = there.modes.trajectory.states - here.modes.trajectory.states
    np.testing.assert_allclose(moved, np.broadcast_to([6 * np.pi, 0.0], moved.shape), atol=1e-9)


def test_solve_refuses_bad_parameters():
    with pytest.raises(OutsideBoxError):
        solve(PENDULUM, [7.0, 3.0])
    with pytest.raises(ValueError, match="finite"):
        solve(PENDULUM, [np.nan, 0.0], extrapolate=True)
    with pytest.raises(ValueError, match="one instance"):
        solve(PENDULUM, [[0.0, 0.0], [1.0, 0.0]])


def test_quadcopter_round_an_obstacle():
    p = np.array([[8.0, 2.0, 1.0, 4.0, 1.2, 0.3, 2.0]])
    solution = Solver(QUADCOPTER_OBSTACLE).solve(*line(QUADCOPTER_OBSTACLE, p))
    assert solution.status[0] == Status.SOLVED
    distance = np.linalg.norm(solution.trajectory.states[0, :, :3] - p[0, 3:6], axis=1)
    assert distance.min() == pytest.approx(2.0, abs=1e-4)
    assert solution.multipliers[0].max() > 0.1


def test_threads_solve_with_no_more_solvers_than_cores(monkeypatch):
    made = []

    def make(problem, settings):
        made.append(Solver(problem, settings))
        return made[-1]

    monkeypatch.setattr(solver, "GuardedSolver", make)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    problem = dataclasses.replace(DOUBLE_INTEGRATOR)
    expected = [solve(problem, [number + 0.5, 0.0], starts=1).cost for number in range(4)]
    assert in_threads(lambda number: solve(problem, [number + 0.5, 0.0], starts=1).cost) == expected
    assert 1 <= len(made) <= 2


def to(target):
    """The problem with the disc and another goal."""
    goal = Goal(state=target, radius=0.1, windings=[[0] * 4], control=[0.0, 0.0])
    return dataclasses.replace(DISC, id="DiscTo-v0", goal=goal)


@pytest.mark.parametrize(
    ("problem", "p", "reason"),
    [
        (DISC, [-0.5, 0.3, 1.0], "clearance 0 is -0.416905, less than 0, at knot 0, the initial state"),
        (to([1.0, 0, 0, 0]), [-3.0, 0.0, 1.5], "clearance 0 is -0.49998, less than 0, at knot 20, the goal"),
        (DISC, [-30.0, 0.0, 1.0], r"state x = -30 lies outside its box \[-20, 20\] at knot 0, the initial state"),
    ],
    ids=["initial state", "goal", "box"],
)
def test_an_instance_whose_ends_violate_a_constraint_is_told_without_a_solve(problem, p, reason, monkeypatch):
    monkeypatch.setattr(optimum, "lent_solvers", lambda problem: pytest.fail("it is solved"))
    solution = solve(problem, p, extrapolate=True)
    assert solution.status == Status.INFEASIBLE
    assert re.fullmatch(reason, solution.reason)
    assert solution.cost == np.inf
    assert np.isnan(solution.trajectory.flat()).all()


@pytest.fixture
def unguarded(monkeypatch):
    monkeypatch.setattr(optimum, "lent_solvers", lambda problem: Loans(partial(Solver, problem), 1))


def test_an_infeasible_instance_is_told_by_what_the_best_attempt_violates(unguarded):
    """Nothing swings up within a second."""
    solution = solve(dataclasses.replace(PENDULUM, duration=(0.1, 1.0)), [0.0, 0.0], starts=1)
    assert solution.status == Status.INFEASIBLE
    assert re.fullmatch(
        r"the best attempt violates the dynamics of (theta|omega) most, at knot \d+ by 0\.\d+ of its scale",
        solution.reason,
    )


def test_a_derivative_that_is_not_finite_is_named():
    def distance(x, u, s, c):
        return ((x[0] - 1) ** 2 + x[1] ** 2) ** 0.5 + 0.1 * u[0] ** 2 + 0.1

    problem, p = dataclasses.replace(DOUBLE_INTEGRATOR, id="Distance-v0", cost_rate=distance), np.array([[1.0, 0.0]])
    guess = guesses(problem, p, np.array([0]), np.random.default_rng(0), "line")
    assert not_finite(problem, p, guess).startswith(
        "the gradient of the cost rate is not finite at knot 0, state [1, 0]"
    )
    assert not_finite(DOUBLE_INTEGRATOR, p, guess) == ""


def test_solve_searches_near_its_first_solution(unguarded):
    """From bends of a line, fatrop hangs on this problem in one of six cases."""
    p = [8.0, 2.0, 1.0, 4.0, 1.2, 0.3, 2.0]
    alone = solve(QUADCOPTER_OBSTACLE, p, starts=1)
    several = solve(QUADCOPTER_OBSTACLE, p, starts=4)
    assert several.cost <= alone.cost
    assert several.status == Status.SOLVED
