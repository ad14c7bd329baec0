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
from ocp_envs.support.doors import checked

#: Under these names the encoding is stored with a policy; a policy without them has the plain encoding.
_PREFIX, _NAMES = "encoding.", ("widths", "centre", "directions")


@checked
@dataclass(frozen=True, eq=False)
class Encoding:
    """What distinguishes the features and actions of a learner from the plain ones, each by default nothing.

    Args:
        widths: those of features near the goal, (n, nx), see :mod:`moe_policy.rl.features`.
        centre: the control that no action represents, (nu,), see :mod:`moe_policy.rl.actions`.
        directions: what a full action adds to it, one column for each action, (nu, nu).
    """

    widths: Array | None = None
    centre: Array | None = None
    directions: Array | None = None

    @property
    def tensors(self) -> dict[str, Array]:
        """What a policy stores of the encoding, by name."""
        parts = {name: getattr(self, name) for name in _NAMES}
        return {_PREFIX + name: values for name, values in parts.items() if values is not None}


def stored_encoding(tensors: Mapping[str, Any]) -> Encoding:
    """The encoding whose :attr:`Encoding.tensors` are among ``tensors``."""
    return Encoding(**{name: tensors.get(_PREFIX + name) for name in _NAMES})


def features_of(problem: OptimalControlProblem, encoding: Encoding) -> Features:
    """The features of ``encoding`` on ``problem``; a ``ValueError`` where they do not fit it."""
    return Features(problem, encoding.widths)


def actions_of(problem: OptimalControlProblem, encoding: Encoding) -> Actions:
    """The actions of ``encoding`` on ``problem``; a ``ValueError`` where they do not fit it."""
    return Actions(problem, encoding.centre, encoding.directions)


def encoding_of(
    problem: OptimalControlProblem, near_goal: int, stride: float | Sequence[float], period: float
) -> Encoding:
    """The encoding that follows from the declaration of ``problem``.

    Args:
        problem: the problem.
        near_goal: number of widths of the features near the goal.
        stride: of actions round the goal, see :mod:`moe_policy.rl.actions`; with 0 actions cover the whole box.
        period: seconds between two decisions.
    """
    widths = widths_near_goal(problem, near_goal) if near_goal else None
    if not np.any(stride):
        return Encoding(widths)
    actions = Actions.round_goal(problem, stride, period)
    return Encoding(widths, actions.centre, actions.directions)
