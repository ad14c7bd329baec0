"""Who takes part."""

import ocp_envs
from moe_policy.experiments import methods
from moe_policy.planners.margin import WithMargin
from moe_policy.planners.symmetric import Symmetrised
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE


def test_the_shipped_ones_come_in_the_studys_order():
    names = [method.name for method in methods.shipped(PENDULUM)]
    assert names[:4] == ["nearest", "snn", "moe-custom", "moe-kmeans-4"]
    assert "sac" in names
    assert all(method.data for method in methods.shipped(PENDULUM))


def test_only_goals_that_can_be_held_have_a_stabiliser():
    assert [c.name for c in methods.stabiliser(PENDULUM)] == ["stabiliser"]
    assert methods.stabiliser(ocp_envs.load("GroundVehicle-v0")) == []


def test_networks_once_more_used_with_care():
    shipped = methods.shipped(QUADCOPTER_OBSTACLE)
    careful = methods.variants(QUADCOPTER_OBSTACLE, shipped)
    networks = [c.name for c in shipped if c.name == "snn" or c.name.startswith("moe-")]
    ways = {"half turn": Symmetrised, "radius + 0.1": WithMargin}
    assert [c.name for c in careful] == [f"{name}, {way}" for way in ways for name in networks]
    assert all(isinstance(c.actor, ways[c.name.split(", ")[1]]) for c in careful)
    assert methods.variants(PENDULUM, methods.shipped(PENDULUM)) == []
