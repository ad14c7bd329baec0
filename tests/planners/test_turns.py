"""Plans do not depend on the turn in which the angles of the parameters are written."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import moe_policy
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.solver import SolverPlanner
from moe_policy.planners.stored import StoredPlans
from moe_policy.planners.symmetric import Symmetrised
from moe_policy.protocols import Policy
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, Coordinate
from ocp_envs.trajectory import Trajectory
from tests.planners.test_solver import Recorder
from tests.synthetic import fake_samples

TURN = 2 * np.pi
SAMPLES = fake_samples(count=60, modes=3)
MODELS = {(p, name): moe_policy.load(p, name) for p in BENCHMARK for name in moe_policy.available(p)}
SHIPPED = [key for key, model in MODELS.items() if not isinstance(model, Policy) and key[1] != "optimal"]


def checked_slowly(keys):
    """``keys`` of models as parameters of a test: checked planners but the pendulum's, which may solve, are slow."""
    slow = [name == "checked" and problem is not PENDULUM for problem, name in keys]
    return [pytest.param(*key, marks=[pytest.mark.slow] if is_slow else []) for key, is_slow in zip(keys, slow)]


# A pendulum that is symmetric, with an angle among its parameters and its length as context.
LONG = dataclasses.replace(
    PENDULUM,
    parameters=Box((Coordinate("theta", 0.0, TURN, "rad"), Coordinate("length", 0.5, 1.5, "m"))),
    symmetry=Symmetry("point reflection", [-1.0, -1.0], [-1.0], [1.0]),
)


def absolute(p):
    """Plans for LONG that know angles from their whole turns, as a function of somebody else may."""
    progress = np.linspace(0, 1, LONG.knots)[:, None]
    initial, _ = LONG.start(p)
    states = initial[:, None] * np.cos(progress) + progress * LONG.goal.state
    controls = np.tile(np.sin(0.3 * p[:, :1, None]), (1, LONG.knots - 1, 1))
    return Trajectory(states, controls, 1 + np.abs(p[:, 0]))


@st.composite
def instances(draw, problem):
    """Parameters in the box (B, np), and whole turns for each (B,)."""
    unit = st.floats(0, 1, exclude_max=True, width=32)
    rows = draw(st.lists(st.tuples(*[unit] * len(problem.parameters)), min_size=1, max_size=4))
    p = problem.parameters.lower + np.array(rows) * problem.parameters.width
    return p, np.array(draw(st.lists(st.integers(-5, 5), min_size=len(p), max_size=len(p))))


def check(planner, problem, p, turns, tolerance=1e-9):
    """The plans for ``p`` and for the same instances in other ``turns`` differ by these turns alone."""
    angles = np.isin(problem.parameters.names, [c.name for c in problem.system.state.coordinates if c.period])
    written = p + turns[:, None] * TURN * angles
    moved = problem.start(written)[0] - problem.start(p)[0]
    np.testing.assert_allclose(planner(written).flat(), planner(p).shifted(moved).flat(), rtol=0, atol=tolerance)


@pytest.mark.parametrize(("problem", "name"), checked_slowly(SHIPPED), ids=lambda value: getattr(value, "id", value))
@settings(max_examples=15)
@given(data=st.data())
def test_shipped_planners_plan_the_same_in_every_turn(problem, name, data):
    # Checked plans may be repaired, and the solver ends where its tolerance says.
    tolerance = 1e-5 if name == "checked" else 1e-9
    check(MODELS[problem, name], problem, *data.draw(instances(problem)), tolerance)


def in_another_turn(samples, turns):
    shift = np.tile([TURN * turns, 0.0], (len(samples), 1))
    parameters, trajectory = samples.parameters + shift, samples.trajectory.shifted(shift)
    return dataclasses.replace(samples, parameters=parameters, trajectory=trajectory)


MIXTURE = MODELS[PENDULUM, "moe-custom"]
KINDS = {
    "solver, warm starts": SolverPlanner(PENDULUM, SAMPLES, solver=Recorder()),
    "solver, random guesses": SolverPlanner(PENDULUM, random_guesses=2, solver=Recorder()),
    "solver, plans": SolverPlanner(PENDULUM, guessers=MIXTURE.expert_planners(), solver=Recorder()),
    "one expert": MIXTURE.expert_planners()[0],
    "plans of all experts": lambda p: MIXTURE.experts(p)[1],
    "samples in another turn": NearestPlanner(in_another_turn(SAMPLES, -2)),
}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15)
@given(instance=instances(PENDULUM))
def test_every_kind_of_planner_plans_the_same_in_every_turn(kind, instance):
    check(KINDS[kind], PENDULUM, *instance)


@pytest.mark.parametrize("planner", [WithMargin(LONG, absolute, "length", 0.1), Symmetrised(LONG, absolute)])
@given(instance=instances(LONG))
def test_planners_of_planners_plan_the_same_in_every_turn(planner, instance):
    """Except where an instance is its own mirror image: two families are equally good there."""
    p, turns = instance
    others = np.abs(LONG.system.difference(LONG.start(p)[0], -LONG.start(p)[0])).max(axis=1) > 1e-3
    check(planner, LONG, p[others], turns[others])


@given(instance=instances(LONG))
def test_the_plan_of_a_mirrored_instance_is_the_mirror_image(instance):
    """Whatever the planner, except where an instance is its own mirror image."""
    planner, (p, _) = Symmetrised(LONG, absolute), instance
    p = p[np.abs(LONG.system.difference(LONG.start(p)[0], -LONG.start(p)[0])).max(axis=1) > 1e-3]
    mirrored = p * [-1.0, 1.0]
    wanted = LONG.symmetry.trajectories(planner(p)).flat()
    np.testing.assert_allclose(planner(mirrored).flat(), wanted, rtol=0, atol=1e-9)


SYMMETRIC = [(problem, name) for problem, name in SHIPPED if problem.symmetry is not None]


@pytest.mark.parametrize(("problem", "name"), checked_slowly(SYMMETRIC), ids=lambda value: getattr(value, "id", value))
def test_symmetrised_models_of_the_package_are_equivariant(problem, name):
    planner, symmetry = Symmetrised(problem, MODELS[problem, name]), problem.symmetry
    p = problem.parameters.draw(np.random.default_rng(0), 300)
    states, contexts = problem.start(p)
    mirrored = problem.parameters_of(symmetry.states(states), symmetry.contexts(contexts))
    wanted = symmetry.trajectories(planner(p)).flat()
    # The mirror image of an instance is rounded: two solves of it agree to the solver's tolerance.
    error = 1e-5 if name == "checked" else 1e-9
    np.testing.assert_allclose(planner(mirrored).flat(), wanted, rtol=0, atol=error)


@given(instance=instances(PENDULUM), stored=st.integers(-3, 3))
def test_stored_plans_are_found_in_every_turn(instance, stored):
    p, turns = instance
    plans = SAMPLES.trajectory[: len(p)]
    p[:, 1] = np.arange(len(p)) / 10  # no two are equal
    shift = np.tile([TURN * stored, 0.0], (len(p), 1))
    check(StoredPlans(p + shift, plans.shifted(shift), PENDULUM), PENDULUM, p, turns)
    with pytest.raises(ValueError, match="no stored plan"):
        StoredPlans(p, plans, PENDULUM)(p + np.array([TURN, 1e-9]))


def test_the_gate_and_the_neighbours_do_not_depend_on_the_turn():
    written = SAMPLES.parameters + np.array([TURN, 0.0])
    np.testing.assert_array_equal(MIXTURE.gate(written)[0], MIXTURE.gate(SAMPLES.parameters)[0])
    np.testing.assert_array_equal(NearestPlanner(SAMPLES).neighbours(written)[:, 0], np.arange(len(SAMPLES)))


def test_samples_in_another_turn_are_those_of_the_same_instances():
    """Their families are those that the turned trajectories have; costs of all families are unknown."""
    given_there = in_another_turn(SAMPLES, 1)
    there = dataclasses.replace(given_there, mode=np.maximum(SAMPLES.mode - 1, 0)).in_one_turn()
    np.testing.assert_allclose(there.parameters, SAMPLES.parameters, atol=1e-13)
    np.testing.assert_allclose(there.trajectory.flat(), SAMPLES.trajectory.flat(), atol=1e-13)
    np.testing.assert_array_equal(there.mode, SAMPLES.mode)
    assert SAMPLES.in_one_turn() is SAMPLES


def test_samples_at_both_ends_of_the_box_stay():
    """A grid over the box has them: the same states, with optimal trajectories that begin at either end."""
    both = dataclasses.replace(SAMPLES[:2], parameters=PENDULUM.parameters.lower + np.array([[0.0, 1.0], [TURN, 1.0]]))
    assert both.in_one_turn() is both
