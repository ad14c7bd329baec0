"""What every problem of the catalogue promises, and what is shipped for it."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial import cKDTree

import moe_policy
import ocp_envs
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.solver import SolverPlanner
from moe_policy.protocols import Policy
from moe_policy.store import ALWAYS, COMPOSED
from ocp_envs.envs.simulation import Simulator
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.sets import reference
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solver import GuardedSolver

#: Few solves, of large problems.
pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
PROBLEMS = tuple({problem.id: problem for problem in (*BENCHMARK, QUADCOPTER, QUADCOPTER_OBSTACLE)}.values())
#: Problems whose reference sets are in the package.
REFERENCED = tuple(p for p in BENCHMARK if all(reference.path_of(p, split).exists() for split in reference.SHIPPED))
MODELS = [(problem, name) for problem in BENCHMARK for name in moe_policy.available(problem.id)]
FILES = [(problem, name) for problem, name in MODELS if name not in {*ALWAYS, *COMPOSED}]
CHECKED = [problem for problem, name in MODELS if name == "checked"]


def name_of(value):
    return getattr(value, "id", str(value))


def corners_and_more(problem, count=40):
    """Parameters inside the box, its lower and its upper corner among them, unless no episode can begin there."""
    p = np.concatenate([sample(problem, 77, count), [problem.parameters.lower, problem.parameters.upper]])
    return np.delete(p, list(infeasible_rows(problem, p, goal=False)), axis=0)


# -- symmetries --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", [p for p in PROBLEMS if p.symmetry is not None], ids=name_of)
def test_a_declared_symmetry_is_one(problem):
    rng, symmetry = np.random.default_rng(0), problem.symmetry

    def draw(box):
        return box.draw(rng, 200)

    x, u, s = draw(problem.system.state), draw(problem.system.control), draw(problem.context)
    images = symmetry.states(x), symmetry.controls(u), symmetry.contexts(s)
    (derivative, rate), (image_derivative, image_rate) = (
        problem.functions.rate()(*each) for each in ((x, u, s), images)
    )
    np.testing.assert_allclose(image_derivative, symmetry.states(derivative), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(image_rate, rate, rtol=1e-12)
    if problem.n_clearances:
        (clearance,), (image_clearance,) = (problem.functions.clearances()(a, b) for a, b in ((x, s), images[::2]))
        np.testing.assert_allclose(image_clearance, clearance, atol=1e-9)
    for box, values in zip((problem.system.state, problem.system.control, problem.context), images):
        assert box.contains(values, 1e-9).all()
    np.testing.assert_allclose(symmetry.states(problem.goal.state), problem.goal.state, atol=1e-12)
    np.testing.assert_allclose(symmetry.controls(problem.goal.control), problem.goal.control, atol=1e-12)
    assert not np.allclose(images[0], x)


# -- environments ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", BENCHMARK, ids=name_of)
def test_every_problem_is_an_environment_of_both_kinds(problem):
    assert ocp_envs.load(problem.id) is problem
    assert problem.id in ocp_envs.names()
    env = gym.make(problem.id)
    envs = gym.make_vec(problem.id, num_envs=3)
    assert env.unwrapped.problem is envs.unwrapped.problem is problem
    p = corners_and_more(problem)[-3:]
    together, _ = envs.reset(options={"parameters": p})
    alone = [env.reset(options={"parameters": row})[0] for row in p]
    np.testing.assert_array_equal(together, alone)
    assert together.shape == (3, problem.system.nx + len(problem.context))
    env.close()
    envs.close()


@pytest.mark.parametrize("problem", PROBLEMS, ids=name_of)
def test_the_simulator_makes_the_steps_of_a_solved_plan(problem):
    """From every knot, one tick as long as the interval leads to the next knot, at the program's cost."""
    rng = np.random.default_rng(4)
    p = sample(problem, 4, 10)
    (clearances,) = problem.functions.clearances()(*problem.start(p))
    p = p[(clearances > 0.5).all(axis=1)]
    p, windings = p[:4], np.full(4, len(problem.targets) // 2)
    with GuardedSolver(problem) as solver:
        solutions = solver.solve(p, guesses(problem, p, windings, rng, "line"), windings, retry_with_fallback=False)
    assert solutions.solved.sum() >= 2
    system, (_, contexts) = problem.system, problem.start(p)
    for row in np.flatnonzero(solutions.solved):
        plan = solutions.trajectory[row]
        simulator = Simulator(problem, plan.step[0], problem.substeps)
        held = np.repeat(contexts[row : row + 1], problem.knots - 1, axis=0)
        step = simulator.advance(plan.states[0, :-1], plan.controls[0], held)
        np.testing.assert_allclose(step.states / system.state.scale, plan.states[0, 1:] / system.state.scale, atol=1e-6)
        np.testing.assert_allclose(step.cost.sum(), solutions.cost[row], rtol=1e-6)
        assert step.reached[-1]
        assert not step.reached[: problem.knots // 2].any()
        assert not step.left_box.any()
        assert step.violation.max() < 1e-5


# -- reference sets ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("split", reference.SHIPPED)
@pytest.mark.parametrize("problem", REFERENCED, ids=name_of)
def test_reference_sets_lie_in_the_box_with_finite_costs(problem, split):
    shipped = reference.load(problem, split)
    size = len(shipped)
    assert size >= 1000
    assert shipped.parameters.shape == (size, len(problem.parameters))
    assert shipped.mode_costs.shape == (size, len(problem.modes))
    assert problem.parameters.contains(shipped.parameters).all()
    assert np.isfinite(shipped.cost).all()
    assert (shipped.cost > 0).all()
    np.testing.assert_array_equal(shipped.mode_costs[np.arange(size), shipped.mode], shipped.cost)


@pytest.mark.parametrize("problem", REFERENCED, ids=name_of)
def test_sets_are_disjoint(problem):
    """No start on which models are judged was used to choose among them or to train them."""
    sets = {split: reference.load(problem, split).parameters for split in reference.SHIPPED}
    if (problem, "nearest") in MODELS:
        sets["training"] = moe_policy.load(problem.id, "nearest").parameters
    judged = cKDTree(sets.pop("validation"))
    for name, parameters in sets.items():
        assert judged.query(parameters)[0].min() > 1e-9, name


@pytest.mark.parametrize("count", [10, pytest.param(20, marks=pytest.mark.slow)])
@pytest.mark.parametrize("problem", [p for p in REFERENCED if (p, "nearest") in MODELS], ids=name_of)
def test_no_warm_start_finds_less_than_the_reference_cost(problem, count):
    shipped = reference.load(problem, "validation")
    nearest = moe_policy.load(problem.id, "nearest")
    p, best = shipped.parameters[:count], shipped.cost[:count]
    with GuardedSolver(problem) as solver:  # fatrop hangs on some warm starts of the obstacle problem
        planner = SolverPlanner(problem, nearest, solver=solver)
        cost = planner.best(p)[1]
    assert (cost > best * (1 - 1e-3)).all()
    assert (cost < best * (1 + 1e-3)).sum() >= 0.9 * count


# -- models ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("problem", "name"), MODELS, ids=name_of)
def test_everything_available_loads(problem, name):
    loaded = moe_policy.load(problem.id, name)
    assert loaded.problem is problem
    assert isinstance(loaded, Policy) or callable(loaded)


@pytest.mark.parametrize(("problem", "name"), FILES, ids=name_of)
def test_shipped_planners_plan_and_shipped_policies_act(problem, name):
    loaded, p = moe_policy.load(problem.id, name), corners_and_more(problem)
    if isinstance(loaded, Policy):
        envs = gym.make_vec(problem.id, num_envs=len(p))
        observations, _ = envs.reset(options={"parameters": p})
        actions, _ = loaded.predict(observations, episode_start=np.ones(len(p), bool))
        assert envs.action_space.contains(np.asarray(actions, np.float32))
        return
    plan, system = loaded(p), problem.system
    assert plan.states.shape == (len(p), problem.knots, system.nx)
    assert plan.controls.shape == (len(p), problem.knots - 1, system.nu)
    assert plan.finite.all()
    # A prediction from the wrong problem, or in the wrong scale, would not begin near its own start.
    starts, _ = problem.start(p)
    scale = np.ptp(np.stack([problem.parameters.lower, problem.parameters.upper]), axis=0).max()
    assert np.median(np.abs(plan.states[:, 0] - starts)) < 0.1 * scale
    assert isinstance(loaded, NearestPlanner) or loaded.details["training"]["test_error"] > 0


@pytest.mark.parametrize("problem", CHECKED, ids=name_of)
def test_a_plan_that_is_verified_succeeds(problem):
    """On the model, at the plan's end, with all constraints kept on the whole path, at the cost that was predicted."""
    planner = moe_policy.load(problem, "checked")
    p = np.concatenate([corners_and_more(problem, 10), reference.load(problem, "outside").parameters[:6]])
    checked = planner.check(p)
    policy = moe_policy.TrackingPolicy(problem, moe_policy.StoredPlans(p, checked.trajectory), planner.dt)
    episodes = moe_policy.rollout(moe_policy.environments(problem, len(p), planner.dt), policy, p)
    good = checked.verified
    assert good.sum() >= 10
    assert (episodes.plan_end_error[good] < problem.goal.radius).all()
    assert not episodes.left_box[good].any()
    assert (episodes.violation[good] == 0).all()
    assert (np.nan_to_num(episodes.knot_violation[good]) == 0).all()
    np.testing.assert_allclose([v.cost for v in checked.verdicts if v.verified], episodes.cost[good], rtol=1e-6)
    np.testing.assert_array_equal(checked.trajectory.finite, good)
    assert all(verdict.reason for verdict in checked.verdicts if not verdict.verified)
