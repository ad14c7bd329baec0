"""Layer sizes: those of the paper, and what is refused."""

from __future__ import annotations

import pytest

from moe_policy.learning.architectures import PAPER_SIZES, Architecture, Experts, architecture_of, layer_sizes
from moe_policy.planners.modules import SingleModule
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE


def test_sizes_of_the_paper():
    assert layer_sizes(PENDULUM, architecture_of(PENDULUM).single) == (2, 300, 75)
    assert layer_sizes(QUADCOPTER_OBSTACLE, architecture_of(QUADCOPTER_OBSTACLE).single) == (7, 1000, 1000, 317)
    assert layer_sizes(QUADCOPTER, architecture_of(QUADCOPTER).gate, 4) == (3, 50, 4)
    # The vehicle's two large clusters get 500 units, with k-means 300.
    vehicle = PAPER_SIZES["GroundVehicle-v0"]
    assert [vehicle.expert(size, 20001, "custom") for size in (45626, 7266)] == [(500,), (200,)]
    assert [vehicle.expert(size, 20001, "kmeans") for size in (28913, 7228)] == [(300,), (200,)]
    assert sum(parameter.numel() for parameter in SingleModule((2, 300, 75)).parameters()) == 3 * 300 + 301 * 75


def test_empty_layers_are_refused():
    with pytest.raises(ValueError, match="units of a hidden layer: expected a whole number of at least 1, got 0"):
        Architecture((10,), (0,), Experts((10,), (10,)))
    with pytest.raises(TypeError, match="hidden layers: expected tuple or list, got int 10; write"):
        Architecture(10, (10,), Experts((10,), (10,)))
    with pytest.raises(TypeError, match="units of a hidden layer"):
        Architecture((2.5,), (10,), Experts((10,), (10,)))
