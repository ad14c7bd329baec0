import numpy as np
import pytest

from moe_policy.checking import remedies
from moe_policy.checking.forecast import Predicted
from moe_policy.checking.remedies import Repair, _growth, solved
from moe_policy.checking.selection import Selected
from ocp_envs.support.sharing import Loans
from ocp_envs.trajectory import Trajectory
from tests.solvers.programs import DISC

P = np.array([[-3.0, 0.4, 1.0], [-4.0, 1.5, 1.0], [-4.0, 1.5, 1.0]])


def along(height):
    """Plans along y = ``height`` from the initial states, one for each instance."""
    states = np.zeros((len(P), DISC.knots, 4))
    states[:, :, 0] = np.linspace(P[:, 0], 3.0, DISC.knots).T
    states[:, :, 1] = height
    return Trajectory(states, np.zeros((len(P), DISC.knots - 1, 2)), np.full(len(P), 4.0))


def test_a_margin_grows_where_the_plan_is_clear_at_its_knots_and_the_tracked_path_is_not():
    """A plan that enters the disc at its knots needs more iterations, not a wider berth."""
    clear, clearance = along(np.array([[0.5], [1.5], [1.5]])), np.array([-0.3, -0.2, 0.1])
    np.testing.assert_allclose(_growth(DISC, P, clear, clearance), [0.0, 0.3, 0.0])
    barely = _growth(DISC, P, clear, np.array([-0.3, -1e-5, np.inf]))
    np.testing.assert_allclose(barely, [0.0, 0.01, 0.0])


class Refusing:
    """A solver that solves nothing and notes what it is asked."""

    def __init__(self):
        self.calls = []

    def attempts(self, parameters, guesses, windings, *, retry_with_fallback, rescue, margins):
        self.calls.append((len(parameters), retry_with_fallback, rescue, margins))
        from ocp_envs.solvers.solutions import Solutions

        return Solutions.empty(DISC, len(parameters)), guesses


def test_the_fallback_solver_is_the_last_resort_from_the_likeliest_plan(monkeypatch):
    solver = Refusing()
    monkeypatch.setattr(remedies, "lent_solvers", lambda problem: Loans(lambda: solver, 1))
    success = np.array([True, False, False])
    nothing = Predicted(np.ones(3), np.ones(3), -np.ones(3), ~success, ~success, success, np.ones(3))
    failing = Selected(along(1.5), nothing, np.zeros(3, int), np.zeros(3, int))
    same = solved(None, DISC, P, [along(1.5), along(2.0), along(2.5)], np.array([0.1, 0.2, 0.3]), failing)
    assert same is failing
    assert [call[:3] for call in solver.calls] == [(6, False, False), (2, True, True)]
    np.testing.assert_allclose(solver.calls[0][3][:, 10], [0.2, 0.3] * 3)


@pytest.mark.parametrize("rounds", [0, 2])
def test_repairs_are_values(rounds):
    assert Repair(5, rounds) == Repair(iterations=5, rounds=rounds, margin=0.0)
