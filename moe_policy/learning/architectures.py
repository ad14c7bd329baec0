"""Layer sizes of the benchmark's networks: the paper's (Tang & Hauser, table II), and a default for other problems.

Only hidden layers are named; inputs and outputs follow from the problem.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType, NoneType

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.checks import check_kind, check_whole

Hidden = tuple[int, ...]


def check_hidden(hidden: Hidden) -> None:
    """Refuse ``hidden`` that are no widths of layers: with a TypeError, or a ValueError for one below 1."""
    check_kind("hidden layers", hidden, (tuple, list), "write (50,) for one layer of 50 units")
    for width in hidden:
        check_whole("units of a hidden layer", width)


@dataclass(frozen=True)
class Experts:
    """Hidden layers of a mixture's experts: ``small`` up to the average size of a cluster, ``large`` above it."""

    small: Hidden
    large: Hidden

    def __post_init__(self) -> None:
        check_hidden(self.small)
        check_hidden(self.large)


@dataclass(frozen=True)
class Architecture:
    """Hidden layers of a problem's networks.

    Args:
        single: the single network.
        gate: the mixture's classifier.
        experts: the mixture's regressors.
        kmeans_experts: the regressors on k-means clusters where they differ, else ``None``.
    """

    single: Hidden
    gate: Hidden
    experts: Experts
    kmeans_experts: Experts | None = None

    def __post_init__(self) -> None:
        check_kind("experts", self.experts, Experts)
        check_kind("kmeans_experts", self.kmeans_experts, (Experts, NoneType))
        parts = [self.single, self.gate]
        for experts in (self.experts, self.kmeans_experts or self.experts):
            parts += [experts.small, experts.large]
        for hidden in parts:
            check_hidden(hidden)

    def expert(self, size: int, average: float, method: str) -> Hidden:
        """Hidden layers for a cluster of ``size`` samples, found by ``method``, where clusters have ``average``
        samples.
        """
        experts = self.kmeans_experts if self.kmeans_experts and method.startswith("kmeans") else self.experts
        return experts.large if size > average else experts.small


#: The paper's layer sizes by problem id, the default for these problems.
PAPER_SIZES: Mapping[str, Architecture] = MappingProxyType(
    {
        "PendulumSwingup-v0": Architecture((300,), (50,), Experts((20,), (20,))),
        "GroundVehicle-v0": Architecture((200, 200), (200,), Experts((200,), (500,)), Experts((200,), (300,))),
        "Quadcopter-v0": Architecture((200,), (50,), Experts((50,), (50,))),
        "QuadcopterObstacle-v0": Architecture((1000, 1000), (200, 200), Experts((200, 200), (200, 200))),
    }
)


_NARROW = Architecture((200, 200), (50, 50), Experts((50, 50), (50, 50)))
#: Sizes of other problems of the benchmark where they are not the default.
_OWN_SIZES: Mapping[str, Architecture] = MappingProxyType(
    {
        "PendulumUncertain-v0": _NARROW,
        "CartPoleSwingup-v0": Architecture((200, 200), (50, 50), Experts((100, 100), (200, 200))),
        "QuadcopterRecovery-v0": _NARROW,
    }
)
#: Sizes of the networks of any other problem.
_DEFAULT = Architecture((200, 200), (50, 50), Experts((100, 100), (100, 100)))


def architecture_of(problem: OptimalControlProblem) -> Architecture:
    """The default architecture of ``problem``: the paper's where it has one.

    Networks of any other problem have two hidden layers, of 200 units in a single network, of half as many in experts
    and of a quarter in the gate.
    """
    return PAPER_SIZES.get(problem.id) or _OWN_SIZES.get(problem.id, _DEFAULT)


def layer_sizes(problem: OptimalControlProblem, hidden: Hidden, outputs: int | None = None) -> tuple[int, ...]:
    """All layer sizes of a network from parameters of ``problem`` through ``hidden`` layers to ``outputs`` logits, by
    default to a flat trajectory.
    """
    return (len(problem.parameters), *hidden, problem.flat_size if outputs is None else outputs)
