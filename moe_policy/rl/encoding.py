"""The encoding of a learner: what it sees of an observation, and the control that its action represents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from moe_policy.rl.actions import Actions
from moe_policy.rl.features import Features, widths_near_goal
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

#: Under these names the encoding is stored with a policy; a policy without them has the plain encoding.
_PREFIX = "encoding."


@dataclass(frozen=True, eq=False)
class Encoding:
    """The ``features`` and ``actions`` of a learner."""

    features: Features
    actions: Actions

    @classmethod
    def plain(cls, problem: OptimalControlProblem) -> Encoding:
        """The encoding of ``problem`` with no features near the goal and actions over the whole box."""
        return cls(Features(problem), Actions(problem))

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, near_goal: int, stride: float | Sequence[float], period: float
    ) -> Encoding:
        """The encoding that follows from the declaration of ``problem``.

        Args:
            problem: the problem.
            near_goal: number of widths of the features near the goal.
            stride: of actions round the goal, see :mod:`moe_policy.rl.actions`; with 0 actions cover the whole box.
            period: seconds between two decisions.
        """
        actions = Actions.round_goal(problem, stride, period) if np.any(stride) else Actions(problem)
        return cls(Features(problem, widths_near_goal(problem, near_goal)), actions)

    @property
    def tensors(self) -> dict[str, Array]:
        """What a policy stores of the encoding; nothing where it is the plain one."""
        problem, actions = self.features.problem, self.actions
        plain = Actions(problem)
        parts: dict[str, Array] = {}
        if len(self.features.widths):
            parts["widths"] = self.features.widths
        if not (np.array_equal(plain.centre, actions.centre) and np.array_equal(plain.directions, actions.directions)):
            parts |= {"centre": actions.centre, "directions": actions.directions}
        return {_PREFIX + name: values for name, values in parts.items()}

    @classmethod
    def stored(cls, problem: OptimalControlProblem, tensors: Mapping[str, Any]) -> Encoding:
        """The encoding of ``problem`` that :attr:`tensors` has stored among other ``tensors``."""
        widths, centre, directions = (tensors.get(_PREFIX + name) for name in ("widths", "centre", "directions"))
        return cls(Features(problem, widths), Actions(problem, centre, directions))
