import dataclasses

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.check import verify
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.solvers.programs import DISC, line

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]


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


@pytest.mark.parametrize("points", [1, 3])
def test_no_trajectories_are_checked_as_well(points):
    problem = dataclasses.replace(DISC, clearance_points=points)
    nothing = problem.unflatten(np.empty((0, problem.flat_size)))
    assert verify(problem, np.empty((0, len(problem.parameters))), nothing, np.empty(0)).passed.shape == (0,)
