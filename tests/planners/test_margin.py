import numpy as np
import pytest

import ocp_envs
from moe_policy.planners.margin import WithMargin
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

P = np.array([8.0, 8.0, 8.0, 4.0, 4.0, 4.0, 4.95])


def asked(p):
    """In place of a planner, to see what it is asked for."""
    return p


def test_the_planner_is_asked_for_a_larger_sphere_from_the_same_start():
    planner = WithMargin(QUADCOPTER_OBSTACLE, asked, "radius", 0.1)
    for given in (P, np.tile(P, (3, 1))):
        shift = planner(given) - np.atleast_2d(given)
        assert np.allclose(shift, [0, 0, 0, 0, 0, 0, 0.1])
    assert planner.name == "planner, radius + 0.1"


def test_no_margin_changes_nothing():
    p = ocp_envs.tables.starts(QUADCOPTER_OBSTACLE)[:5]
    assert np.array_equal(WithMargin(QUADCOPTER_OBSTACLE, asked, "radius", 0.0)(p), p)


@pytest.mark.parametrize(
    ("problem", "parameter"), [(QUADCOPTER_OBSTACLE, "x"), (QUADCOPTER_OBSTACLE, "mass"), (PENDULUM, "radius")]
)
def test_only_the_context_has_margins(problem, parameter):
    with pytest.raises(ValueError, match="expected a parameter of the context"):
        WithMargin(problem, asked, parameter, 0.1)


def test_a_margin_is_a_number():
    with pytest.raises(ValueError, match="finite"):
        WithMargin(QUADCOPTER_OBSTACLE, asked, "radius", np.nan)
