import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import ocp_envs.solvers.compilation
from ocp_envs.goal import Goal
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.guesses import NEAREST_WINDING, guesses
from ocp_envs.solvers.nlp import Outcome, SolverSettings, Status
from ocp_envs.solvers.solutions import best_per_mode
from ocp_envs.solvers.solver import solve
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.system import Box, Coordinate, System
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR

pytestmark = pytest.mark.filterwarnings("ignore::ocp_envs.solvers.compilation.CompiledNotAvailable")
IPOPT = SolverSettings(primary="ipopt")


def box(**bounds):
    return Box(tuple(Coordinate(name, -b, b) for name, b in bounds.items()))


#: A point mass in the plane that has to get round a disc at the origin: p = (x, y, radius).
DISC = OptimalControlProblem(
    id="Disc-v0",
    title="move a mass round a disc",
    system=System(
        name="point mass",
        state=box(x=20.0, y=20.0, vx=10.0, vy=10.0),
        control=box(ux=10.0, uy=10.0),
        constants={},
        dynamics=lambda x, u, c: [x[2], x[3], u[0], u[1]],
    ),
    parameters=Box((*box(x=5.0, y=5.0).coordinates, Coordinate("radius", 0.1, 2.0, "m"))),
    cost_rate=lambda x, u, s, c: 1 + u[0] ** 2 + u[1] ** 2,
    goal=Goal(state=[3.0, 0, 0, 0], radius=0.1, windings=[[0] * 4], control=[0.0, 0.0]),
    duration=(0.5, 15.0),
    knots=21,
    substeps=1,
    hold=1.0,
    time_limit=20.0,
    clearance=lambda x, s, c: [(x[0] ** 2 + x[1] ** 2 + 1e-12) ** 0.5 - s.radius],
)


@pytest.fixture(scope="module", autouse=True)
def _interpreted():
    """Compilation has its own tests; everything else goes without, and so in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ocp_envs.solvers.compilation, "find_compiler", lambda: None)
        yield


@pytest.fixture(scope="module")
def pendulum():
    return Solver(PENDULUM)


def line(problem, p, winding=0):
    p = np.atleast_2d(p)
    return p, guesses(problem, p, np.full(len(p), winding), np.random.default_rng(0), "line"), np.full(len(p), winding)


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
    (clearance,) = DISC.batch_clearances()(solution.trajectory.states[0], np.full((DISC.knots, 1), 1.0))
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
    assert solution.status[0] == Status.NOT_CONVERGED
    assert solution.cost[0] == np.inf
    assert np.isnan(solution.trajectory.flat()).all()


def test_a_stuck_primary_solver_gets_a_second_attempt_with_a_longer_duration(monkeypatch):
    solver, seen = Solver(DOUBLE_INTEGRATOR), []
    run = solver.runner.nlp.primary.run

    def stuck_at_first(task, lower, upper):
        seen.append(task)
        outcome, iterations = run(task, lower, upper)
        return (Outcome.STUCK if len(seen) == 1 else outcome), iterations

    monkeypatch.setattr(solver.runner.nlp.primary, "run", stuck_at_first)
    result = solver.solve(*line(DOUBLE_INTEGRATOR, [2.0, 0.0]), retry_with_fallback=False)
    assert result.solved[0]
    assert not result.fallback[0]
    second = transcribe(DOUBLE_INTEGRATOR).unpack(seen[1].guess[None], np.array([[2.0, 0.0]]))
    assert second.duration[0] == pytest.approx(0.75 * DOUBLE_INTEGRATOR.duration[1])


def test_what_the_primary_solver_breaks_down_on_goes_to_the_fallback(monkeypatch):
    solver = Solver(DOUBLE_INTEGRATOR)

    def broken(task, lower, upper):
        return Outcome.BROKE_DOWN, 3

    monkeypatch.setattr(solver.runner.nlp.primary, "run", broken)
    result = solver.solve(*line(DOUBLE_INTEGRATOR, [2.0, 0.0]), retry_with_fallback=False)
    assert result.solved[0]
    assert result.fallback[0]
    assert result.iterations[0] > 3


@pytest.mark.parametrize("retry", [True, False])
def test_the_fallback_retries_what_did_not_converge_only_where_asked(retry):
    hurried = dataclasses.replace(PENDULUM, duration=(0.1, 1.0))
    result = Solver(hurried).solve(*line(hurried, [0.0, 0.0], 1), retry_with_fallback=retry)
    assert result.status[0] == Status.NOT_CONVERGED
    assert result.fallback[0] == retry


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
    broken = Trajectory(tried.states * np.nan, tried.controls, tried.duration)
    with pytest.raises(ValueError, match="guess 0 is not finite"):
        pendulum.solve(p, broken, windings)
    with pytest.raises(ValueError, match="primary must be"):
        SolverSettings(primary="snopt")
    with pytest.raises(ValueError, match="kind must be"):
        guesses(PENDULUM, p, windings, np.random.default_rng(0), "spiral")


@pytest.mark.parametrize("kind", ["line", "rollout", "drift"])
def test_guesses_are_bounded_and_start_right(kind):
    rng = np.random.default_rng(1)
    p = np.array([[0.1, 1.9], [6.2, -2.0]])
    plans = guesses(PENDULUM, p, np.array([0, 2]), rng, kind)
    np.testing.assert_array_equal(plans.states[:, 0], p)
    assert PENDULUM.system.state.contains(plans.states).all()
    assert PENDULUM.system.control.contains(plans.controls).all()
    if kind != "rollout":
        np.testing.assert_allclose(plans.states[:, -1], PENDULUM.targets[[0, 2]], atol=1e-12)


# -- the independent check -------------------------------------------------------------------------------------------


def test_check_finds_every_kind_of_fault(pendulum):
    p, tried, windings = line(PENDULUM, [[0.5, 0.1]], 1)
    good = pendulum.solve(p, tried, windings)
    plan, cost = good.trajectory, good.cost
    check = verify(PENDULUM, p, plan, cost)
    assert check.passed[0]
    assert check.defect[0] < 1e-6
    assert check.cost[0] == pytest.approx(cost[0], rel=1e-9)

    def changed(**parts):
        fields = {f.name: getattr(plan, f.name).copy() for f in dataclasses.fields(plan)}
        for name, (where, amount) in parts.items():
            fields[name][where] += amount
        return verify(PENDULUM, p, Trajectory(**fields), cost)

    assert changed(states=((0, 0, 0), 1e-4)).defect[0] > 1e-6  # another start
    assert changed(states=((0, 7, 1), 1e-4)).defect[0] > 1e-6
    assert changed(states=((0, 24, 0), 1e-3)).goal[0] > 1e-5
    assert changed(controls=((0, 3, 0), 3.0)).bounds[0] > 0.1
    assert changed(duration=(0, 8.0)).bounds[0] > 0.1
    for parts in ({"states": ((0, 7, 1), np.nan)}, {"states": ((0, 7, 1), 1e-4)}, {"controls": ((0, 3, 0), 3.0)}):
        assert not changed(**parts).passed[0]
    assert not verify(PENDULUM, p, plan, cost * 1.001).passed[0]
    assert not verify(PENDULUM, p + 0.01, plan, cost).passed[0]


def test_check_finds_a_plan_through_the_obstacle():
    solver, p = Solver(DISC), np.array([[-3.0, 0.3, 1.0]])
    plan = solver.solve(*line(DISC, p)).trajectory
    assert verify(DISC, p, plan).passed[0]
    assert len(verify(DISC, p[:0], plan[:0]).passed) == 0
    check = verify(DISC, p + np.array([0, 0, 0.2]), plan)
    assert check.path[0] == pytest.approx(0.2, abs=1e-3)
    assert not check.passed[0]


# -- the best of one parameter ---------------------------------------------------------------------------------------


def test_solve_finds_every_mode():
    solution = solve(PENDULUM, [np.pi - 0.5, 0.0], starts=2)
    assert solution.status == Status.SOLVED
    assert solution.mode == 1
    assert solution.cost == solution.modes.cost.min()
    assert (solution.modes.status == Status.SOLVED).all()
    np.testing.assert_allclose(solution.modes.trajectory.states[:, -1], PENDULUM.targets, atol=1e-4)
    assert verify(PENDULUM, solution.parameters[None], solution.trajectory).passed[0]


def test_a_mode_that_was_not_found_is_empty(pendulum):
    found = pendulum.solve(*line(PENDULUM, [[np.pi - 0.5, 0.0]] * 2, 1))
    best = best_per_mode(PENDULUM, np.array([np.pi - 0.5, 0.0]), found)
    np.testing.assert_array_equal(best.status, [Status.EMPTY, Status.SOLVED, Status.EMPTY])
    np.testing.assert_array_equal(np.isfinite(best.cost), best.solved)
    np.testing.assert_array_equal(best.trajectory.finite, best.solved)


def test_solve_refuses_bad_parameters():
    with pytest.raises(OutsideBoxError):
        solve(PENDULUM, [7.0, 0.0])
    with pytest.raises(ValueError, match="finite"):
        solve(PENDULUM, [np.nan, 0.0], extrapolate=True)
    with pytest.raises(ValueError, match="one parameter"):
        solve(PENDULUM, [[0.0, 0.0], [1.0, 0.0]])


def test_quadcopter_round_an_obstacle():
    p = np.array([[8.0, 2.0, 1.0, 4.0, 1.2, 0.3, 2.0]])
    solution = Solver(QUADCOPTER_OBSTACLE).solve(*line(QUADCOPTER_OBSTACLE, p))
    assert solution.status[0] == Status.SOLVED
    distance = np.linalg.norm(solution.trajectory.states[0, :, :3] - p[0, 3:6], axis=1)
    assert distance.min() == pytest.approx(2.0, abs=1e-4)
    assert solution.multipliers[0].max() > 0.1


# -- guesses -----------------------------------------------------------------------------------------------------------


def test_bent_guesses_pass_an_obstacle_on_every_side():
    p, winding = np.tile([[-3.0, 0.3, 1.0]], (60, 1)), np.zeros(60, int)
    bent = guesses(DISC, p, winding, np.random.default_rng(0), "bend")
    straight = guesses(DISC, p, winding, np.random.default_rng(0), "line")
    np.testing.assert_allclose(bent.states[:, 0], straight.states[:, 0])
    np.testing.assert_allclose(bent.states[:, -1], straight.states[:, -1])
    box = DISC.system.state
    assert ((bent.states >= box.lower) & (bent.states <= box.upper)).all()
    middle = (bent.states - straight.states)[:, DISC.knots // 2]
    assert (middle > 0.1).any(axis=0).all()
    assert (middle < -0.1).any(axis=0).all()
