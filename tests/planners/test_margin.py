import numpy as np
import pytest

import ocp_envs
from moe_policy.planners.margin import WithMargin
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE

P = np.array([8.0, 8.0, 8.0, 4.0, 4.0, 4.0, 4.95])


def nothing(p):
    """A planner that fails."""
    return QUADCOPTER_OBSTACLE.unflatten(np.full((len(p), QUADCOPTER_OBSTACLE.flat_size), np.nan))


def asked(margin, p):
    """What the planner is asked for, (B, np)."""
    calls = []
    WithMargin(QUADCOPTER_OBSTACLE, lambda q: nothing(calls.append(q) or q), "radius", margin)(p)
    return calls[0]


def test_the_planner_is_asked_for_a_larger_sphere_from_the_same_start():
    for given in (P, np.tile(P, (3, 1))):
        shift = asked(0.1, given) - np.atleast_2d(given)
        assert np.allclose(shift, [0, 0, 0, 0, 0, 0, 0.1])
    assert WithMargin(QUADCOPTER_OBSTACLE, nothing, "radius", 0.1).name == "planner, radius + 0.1"


def test_no_margin_changes_nothing():
    p = ocp_envs.tables.starts(QUADCOPTER_OBSTACLE)[:5]
    assert np.array_equal(asked(0.0, p), p)


@pytest.mark.parametrize(
    ("problem", "parameter"), [(QUADCOPTER_OBSTACLE, "x"), (QUADCOPTER_OBSTACLE, "mass"), (PENDULUM, "radius")]
)
def test_only_the_context_has_margins(problem, parameter):
    with pytest.raises(ValueError, match="expected a parameter of the context"):
        WithMargin(problem, nothing, parameter, 0.1)


def test_a_margin_is_a_number():
    with pytest.raises(ValueError, match="finite"):
        WithMargin(QUADCOPTER_OBSTACLE, nothing, "radius", np.nan)
