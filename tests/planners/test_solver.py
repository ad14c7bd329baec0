from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import moe_policy
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.solver import SolverPlanner, lookaround_of
from moe_policy.planners.stored import StoredPlans
from moe_policy.score.optimum import optimal_planner
from ocp_envs.problems import BENCHMARK, PAPER
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.trajectory import Trajectory
from tests.synthetic import fake_samples

SAMPLES = fake_samples(count=150, modes=3)


class Recorder:
    """Solves nothing: gives every guess back as its solution, at a cost that is its duration."""

    def __init__(self, solved=lambda p, duration: np.ones(len(duration), dtype=bool)):
        self.solved, self.calls, self.retried = solved, [], []

    def solve(self, parameters, guesses, windings, *, retry_with_fallback=True):
        self.calls.append((parameters, windings))
        self.retried.append(retry_with_fallback)
        failed = ~self.solved(parameters, guesses.duration)
        flat = guesses.flat()
        flat[failed] = np.nan
        cost = np.where(failed, np.inf, guesses.duration)
        zeros = np.zeros(len(flat))
        status = np.where(failed, 2, 1).astype(np.int8)
        return Solutions(
            Trajectory.from_flat(flat, 25, 2, 1),
            cost,
            zeros[:, None, None],
            status,
            zeros.astype(int),
            zeros.astype(bool),
            zeros,
        )


def test_the_cheapest_solution_is_the_plan_and_failures_are_nan():
    solver = Recorder(lambda p, duration: p[:, 0] < 3)
    everywhere = len(SAMPLES.parameters)
    planner = SolverPlanner(PENDULUM, SAMPLES, neighbours=2, lookaround=everywhere, random_guesses=4, solver=solver)
    p = np.array([[1.0, 0.0], [4.0, 1.0], [2.0, -1.0]])
    plan, cost = planner.best(p)
    np.testing.assert_array_equal(plan.finite, [True, False, True])
    assert cost[1] == np.inf
    np.testing.assert_array_equal(plan.duration[[0, 2]], cost[[0, 2]])
    parameters, windings = solver.calls[0]
    for row in range(3):
        mine = (parameters == p[row]).all(axis=1)
        assert np.bincount(windings[mine] + 1).tolist() == [2 * 3, 4, 4, 4]  # neighbours of 3 modes, then windings


@pytest.mark.parametrize("database", [None, SAMPLES])
def test_plans_of_the_program_do_not_depend_on_the_batch(database):
    planner = SolverPlanner(PENDULUM, database, solver=Recorder())
    p = SAMPLES.parameters[:5] + 0.01
    whole = planner(p).flat()
    np.testing.assert_array_equal(np.concatenate([planner(row).flat() for row in p]), whole)
    assert len(planner(p[:0])) == 0


def test_warm_starts_come_from_the_modes_nearby():
    solver = Recorder()
    p = SAMPLES.parameters[[7]] + 1e-3
    SolverPlanner(PENDULUM, SAMPLES, neighbours=2, lookaround=5, solver=solver)(p)
    (_, windings) = solver.calls[0]
    near = np.argsort((((SAMPLES.parameters - p) / [2 * np.pi, 4]) ** 2).sum(axis=1))[:5]
    expected = np.minimum(np.bincount(SAMPLES.mode[near]), 2).sum()
    assert len(windings) == expected
    assert (windings == -1).all()


def test_what_no_warm_start_solves_is_tried_again_with_a_line_and_the_fallback():
    """The solver refuses whatever lasts as long as a stored trajectory, for one of two problems."""
    p = np.array([[1.0, 0.0], [4.0, 1.0]])
    solver = Recorder(lambda q, duration: (q[:, 0] < 3) | ~np.isin(duration, SAMPLES.trajectory.duration))
    plan, cost = SolverPlanner(PENDULUM, SAMPLES, solver=solver).best(p)
    assert plan.finite.all()
    np.testing.assert_array_equal(plan.duration, cost)
    assert np.isin(cost[0], SAMPLES.trajectory.duration)
    parameters, windings = solver.calls[1]
    assert len(solver.calls) == 2
    assert (parameters == p[1]).all()
    first, _ = solver.calls[0]
    warm = (first == p[1]).all(axis=1).sum()
    assert np.bincount(windings + 1).tolist() == [warm, 1, 1, 1]  # the warm starts, and a line to every winding
    assert solver.retried == [False, True]


def planner_that_fails(rows):
    """The stored plans of the samples, NaN at ``rows``."""
    flat = SAMPLES.trajectory.flat()
    flat[rows] = np.nan
    return StoredPlans(SAMPLES.parameters, PENDULUM.unflatten(flat))


def test_plans_of_planners_are_guesses_beside_those_of_the_database():
    solver, p = Recorder(), SAMPLES.parameters[:3]
    planners = [planner_that_fails([]), NearestPlanner(SAMPLES[3:])]
    SolverPlanner(PENDULUM, SAMPLES, guessers=planners, neighbours=1, lookaround=1, solver=solver)(p)
    parameters, windings = solver.calls[0]
    np.testing.assert_array_equal(parameters, np.tile(p, (3, 1)))
    assert (windings == NEAREST_WINDING).all()


def test_plans_that_are_not_finite_are_no_guesses():
    """The second row has no guess at first; the second trial draws a line for it, with the fallback solver."""
    solver, p = Recorder(), SAMPLES.parameters[:3]
    plan, cost = SolverPlanner(PENDULUM, guessers=[planner_that_fails([1])], solver=solver).best(p)
    np.testing.assert_array_equal(solver.calls[0][0], p[[0, 2]])
    np.testing.assert_array_equal(solver.calls[1][0], np.tile(p[1], (3, 1)))
    np.testing.assert_array_equal(plan.flat()[[0, 2]], SAMPLES.trajectory.flat()[[0, 2]])
    np.testing.assert_array_equal(plan.duration, cost)
    assert solver.retried == [False, True]
    nothing = SolverPlanner(PENDULUM, guessers=[planner_that_fails(slice(None))], solver=Recorder())
    assert nothing(p).finite.all()


def test_the_experts_of_a_mixture_are_guessers(planners):
    solver, p = Recorder(), SAMPLES.parameters[:4]
    mixture = planners["mixture"]
    planner = SolverPlanner(PENDULUM, guessers=[mixture, *mixture.expert_planners()], solver=solver)
    assert planner(p).finite.all()
    assert len(solver.calls[0][0]) == 4 * (1 + 3)
    assert len(planner(p[:0])) == 0


@pytest.mark.parametrize("guessers", [NearestPlanner(SAMPLES), [None], ["moe-custom"]])
def test_guessers_are_planners(guessers):
    with pytest.raises(TypeError, match="sequence of planners as guessers"):
        SolverPlanner(PENDULUM, guessers=guessers, solver=Recorder())


def test_a_planner_in_place_of_a_database_is_told_where_it_belongs(planners):
    with pytest.raises(TypeError, match=r"got NetworkPlanner; give .*guessers=\(planner,\), .*Repaired\(planner\)"):
        SolverPlanner(PENDULUM, planners["single"], solver=Recorder())


@pytest.mark.parametrize("arguments", [{"database": SAMPLES}, {"guessers": [NearestPlanner(SAMPLES)]}])
def test_guesses_belong_to_the_problem(arguments):
    with pytest.raises(ValueError, match="belongs to PendulumSwingup-v0, not to QuadcopterObstacle-v0"):
        SolverPlanner(QUADCOPTER_OBSTACLE, **arguments, solver=Recorder())


@pytest.mark.parametrize(
    "arguments",
    [{"neighbours": -1}, {"lookaround": 0}, {"random_guesses": -1}, {"random_guesses": 1.5}, {"seed": -1}],
)
def test_wrong_numbers_are_named(arguments):
    with pytest.raises((TypeError, ValueError), match=f"^{next(iter(arguments))}: expected a whole number"):
        SolverPlanner(PENDULUM, SAMPLES, solver=Recorder(), **arguments)


def test_without_guesses_there_is_nothing_to_solve():
    with pytest.raises(ValueError, match="no guesses"):
        SolverPlanner(PENDULUM, random_guesses=0, solver=Recorder())


@pytest.mark.slow
def test_the_program_plans_the_pendulum():
    planner = SolverPlanner(PENDULUM)
    plan, cost = planner.best([[0.0, 0.0], [np.pi, 0.1]])
    assert plan.finite.all()
    assert PENDULUM.goal_error(plan.states[:, -1]).max() < 1e-3
    assert cost[1] < cost[0]


def test_the_neighbourhood_is_the_problems_own():
    assert {problem.id: lookaround_of(problem) for problem in PAPER} == {
        "PendulumSwingup-v0": 12,
        "GroundVehicle-v0": 12,
        "Quadcopter-v0": 12,
        "QuadcopterObstacle-v0": 2,
    }
    assert SolverPlanner(QUADCOPTER_OBSTACLE, solver=Recorder()).lookaround == 2
    assert SolverPlanner(QUADCOPTER_OBSTACLE, lookaround=5, solver=Recorder()).lookaround == 5


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_the_optimal_planner_of_the_package_is_the_one_that_is_compared(problem):
    loaded = moe_policy.load(problem, "optimal", kind=SolverPlanner)
    compared = optimal_planner(problem)
    for name in ("lookaround", "neighbours", "random_guesses", "seed"):
        assert getattr(loaded, name) == getattr(compared, name)


def test_an_instance_whose_initial_state_violates_a_constraint_is_not_solved():
    solver = Recorder()
    blocked = dataclasses.replace(PENDULUM, clearance=lambda x, s, c: [(x[0] - 1) ** 2 + x[1] ** 2 - 0.25])
    plan, cost = SolverPlanner(blocked, solver=solver).best([[1.0, 0.0], [2.0, 0.0]])
    np.testing.assert_array_equal(plan.finite, [False, True])
    np.testing.assert_array_equal(np.isfinite(cost), [False, True])
    assert all((parameters[:, 0] == 2.0).all() for parameters, _ in solver.calls)
