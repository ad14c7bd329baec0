"""Weights of 8 bits, for networks that would make the page large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts, SingleNetwork

_LARGEST = np.iinfo(np.int8).max


def whole(weight: NDArray[np.float32]) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """The ``weight`` (outputs, inputs) as whole numbers, and the unit of each row, (outputs,)."""
    units = np.abs(weight).max(axis=1).astype(np.float32) / np.float32(_LARGEST)
    units[units == 0] = 1
    return np.rint(weight / units[:, None]).astype(np.int8), units


def rounded(planner: NetworkPlanner) -> NetworkPlanner:
    """The ``planner`` with weights that are :func:`whole` multiples of units."""
    network = planner.network
    if isinstance(network, SingleNetwork):
        return replace(planner, network=_rounded(network))
    experts = tuple(map(_rounded, network.experts))
    return replace(planner, network=MixtureOfExperts(_rounded(network.gate), experts))


def _rounded(network: SingleNetwork) -> SingleNetwork:
    weights = tuple(numbers * units[:, None] for numbers, units in map(whole, network.weights))
    return SingleNetwork(weights, network.biases)
