from functools import partial

import numpy as np
import pytest

from ocp_envs.solvers import improvement
from ocp_envs.solvers.check import path_violation, residuals, verify
from ocp_envs.solvers.improvement import improve, knot_margins
from ocp_envs.solvers.nlp import Outcome
from ocp_envs.support.sharing import Loans
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.solvers.programs import DISC, line

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
P = np.array([[-3.0, 0.4, 1.0], [-4.0, -0.3, 0.8], [-2.0, 2.0, 1.5]])


@pytest.fixture(autouse=True)
def lent(monkeypatch):
    """Solvers in this process, kept as those in child processes are."""
    kept = {problem.id: Loans(partial(Solver, problem), 1) for problem in (DISC, DOUBLE_INTEGRATOR)}
    monkeypatch.setattr(improvement, "lent_solvers", lambda problem: kept[problem.id])
    return kept


def optimum(problem, p):
    with improvement.lent_solvers(problem).one() as solver:
        return solver.solve(*line(problem, p))


def rough(problem, p, amount, seed=0):
    """Optimal plans with random errors, whose first states are wrong, too."""
    best, rng = optimum(problem, p).trajectory, np.random.default_rng(seed)
    noise = amount * rng.standard_normal(best.states.shape) * problem.system.state.scale
    return Trajectory(best.states + noise, best.controls, best.duration * 1.05)


def error(problem, p, plans):
    found, _ = residuals(problem, p, plans)
    return max(found[name].max() for name in ("dynamics", "goal", "clearance"))


def test_more_iterations_improve_a_plan_until_it_is_the_optimum():
    plans = rough(DISC, P, 0.05)
    errors = [error(DISC, P, improve(DISC, P, plans, k).trajectory) for k in (2, 4, 40)]
    assert errors[2] < 2e-5 < errors[1] < errors[0] < error(DISC, P, plans)
    found = improve(DISC, P, plans)
    assert found.converged.all()
    np.testing.assert_allclose(verify(DISC, P, found.trajectory).cost, optimum(DISC, P).cost, rtol=1e-5)


@pytest.mark.parametrize("iterations", [1, 3, None])
def test_improved_plans_begin_at_the_initial_states(iterations):
    states = improve(DISC, P, rough(DISC, P, 0.05), iterations).trajectory.states
    np.testing.assert_array_equal(states[:, 0], DISC.start(P)[0])


def test_a_limited_number_of_iterations_is_one_attempt_of_one_solver(lent, monkeypatch):
    """A second attempt would begin with another duration, and the fallback would take as long as it likes."""
    plans, calls = rough(DISC, P, 0.05), []
    with lent[DISC.id].one() as solver:
        nlp = solver.runner.nlp
        limited, run = nlp._limited_to(2), nlp._limited_to(2).run
        monkeypatch.setattr(limited, "run", lambda *arguments: calls.append(run(*arguments)) or calls[-1])
        monkeypatch.setattr(nlp.primary, "run", lambda *arguments: pytest.fail("without a limit"))
    assert not improve(DISC, P, plans, 2).converged.any()
    assert [outcome for outcome, _ in calls] == [Outcome.STUCK] * len(P)


def test_a_margin_keeps_the_knots_and_the_path_between_them_clear():
    """A chord of the disc between two knots lies below its surface."""
    contexts, wider = DISC.start(P)[1], DISC.start(P + np.array([0, 0, 0.1]))[1]
    touching, clear = (improve(DISC, P, rough(DISC, P, 0.02), None, margin).trajectory for margin in (0.0, 0.1))
    assert path_violation(DISC, touching, wider).min() > 0.05
    assert path_violation(DISC, clear, wider).max() < 1e-6
    assert path_violation(DISC, middles(touching), contexts).max() > 0.003
    assert path_violation(DISC, middles(clear), contexts).max() == 0.0


def middles(plans):
    """The plans with each state but the last replaced by the middle of its interval."""
    states = plans.states.copy()
    states[:, :-1] = (states[:, :-1] + states[:, 1:]) / 2
    return Trajectory(states, plans.controls, plans.duration)


def test_a_margin_begins_with_the_clearance_of_the_ends():
    """From 2.5 cm in front of the disc, the next knot cannot be 10 cm away from it, but later ones can."""
    p = np.array([[-0.98, 0.3, 1.0], [-4.0, 0.3, 1.0], [0.5, 0.0, 1.0]])
    margins = knot_margins(DISC, p, np.array([0.1, 0.2, 0.1]))
    close = np.hypot(*p[0, :2]) - 1.0
    np.testing.assert_allclose(margins[0], np.minimum(0.1, close + 0.025 * np.arange(20)))
    np.testing.assert_array_equal(margins[1], np.full(20, 0.2))
    np.testing.assert_allclose(margins[2][:5], [0.0, 0.025, 0.05, 0.075, 0.1])  # it begins inside
    found = improve(DISC, p[:2], rough(DISC, p[:2], 0.01), None, 0.1)
    assert found.converged.all()
    clearance = np.linalg.norm(found.trajectory.states[:, 1:, :2], axis=2) - 1.0
    assert (clearance > margins[:2] - 0.1 * (margins[:2] > 0.15) - 1e-6).all()
    np.testing.assert_array_equal(knot_margins(DOUBLE_INTEGRATOR, np.zeros((2, 2)), 0.1), np.full((2, 20), 0.1))


def test_plans_that_are_not_finite_or_break_the_solver_down_stay(lent, monkeypatch):
    plans = rough(DISC, P, 0.02)
    flat = plans.flat()
    flat[1] = np.nan
    broken = DISC.unflatten(flat)
    with lent[DISC.id].one() as solver:
        monkeypatch.setattr(solver.runner.nlp.primary, "run", lambda *_: (Outcome.BROKE_DOWN, 0))
        monkeypatch.setattr(solver.runner.nlp.primary, "w", np.full_like(solver.runner.nlp.primary.w, np.nan))
    found = improve(DISC, P, broken)
    assert not found.converged.any()
    assert found.trajectory.finite.tolist() == [True, False, True]
    np.testing.assert_array_equal(found.trajectory.controls[[0, 2]], plans.controls[[0, 2]])
    np.testing.assert_array_equal(found.trajectory.states[[0, 2], 0], DISC.start(P)[0][[0, 2]])


def test_no_plans_at_all_are_improved():
    assert len(improve(DISC, P[:0], rough(DISC, P, 0.02)[:0]).trajectory) == 0
