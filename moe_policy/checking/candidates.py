"""The plans that are tried for an instance: those of a mixture's likeliest experts, and of each also with margins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from moe_policy.planners.margin import Margin, WithMargin
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import MixtureOfExperts
from moe_policy.planners.owner import planned_problem, plans_of
from moe_policy.protocols import Planner
from ocp_envs.problems import ProblemOrId
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


class Candidates:
    """Several plans for each instance, the likeliest first.

    Of a mixture these are the plans of the experts to which the gate gives the highest probabilities; any other planner
    has one. Each is also planned with each of the margins.

    Args:
        planner: the planner.
        experts: number of experts of a mixture; fewer where it has fewer.
        margins: planners are also asked with each of these.
        problem: what is planned for; by default the ``problem`` of the planner.

    Attributes:
        sources: the planners that plans come from: all experts without a margin, then all with the first one …
        count: number of plans for each instance.

    Raises:
        TypeError: a planner that cannot be called, or another number of experts than a whole one.
        ValueError: fewer than one expert, a margin on a parameter that is not of the context, or a planner without a
            ``problem`` where none is given.
    """

    @checked
    def __init__(
        self,
        planner: Planner,
        experts: int = 2,
        margins: Sequence[Margin] = (),
        *,
        problem: ProblemOrId | None = None,
    ) -> None:
        self.problem = planned_problem(planner, problem)
        check_whole("experts", experts)
        self.planner = planner
        self._gate, plain = None, [planner]
        if isinstance(planner, NetworkPlanner) and isinstance(planner.network, MixtureOfExperts):
            self._gate, plain = planner, list(planner.expert_planners())
        self._experts = min(experts, len(plain))
        self._all, self._variants = len(plain), 1 + len(margins)
        self.sources: list[Planner] = [
            *plain,
            *(WithMargin(self.problem, each, m.parameter, m.amount) for m in margins for each in plain),
        ]
        self.count = self._experts * self._variants

    def __repr__(self) -> str:
        return f"Candidates({self.planner!r}, {self.count} plans for each instance)"

    def __call__(self, p: Array) -> tuple[Ints, tuple[Trajectory, ...]]:
        """Plans of parameters ``p`` (B, np), their angles in the turn around the centre of the box.

        Returns:
            the source of each, an index into ``sources``, (B, count); and ``count`` batches of B plans.
        """
        sources = self._chosen(p)
        return sources, tuple(self._plans(p, column) for column in sources.T)

    def _chosen(self, p: Array) -> Ints:
        if self._gate is None:
            likeliest = np.zeros((len(p), 1), dtype=np.int64)
        else:
            _, probability = self._gate.gate(p)
            likeliest = np.argsort(-probability, axis=1, kind="stable")[:, : self._experts]
        return np.concatenate([likeliest + self._all * variant for variant in range(self._variants)], axis=1)

    def _plans(self, p: Array, source: Ints) -> Trajectory:
        """The plan of the planner ``source`` (B,) for each row of ``p``."""
        if len(p) and (source == source[0]).all():
            return plans_of(self.sources[source[0]], p)
        flat = np.full((len(p), self.problem.flat_size), np.nan)
        for one in np.unique(source):
            rows = source == one
            flat[rows] = plans_of(self.sources[one], p[rows]).flat()
        return self.problem.unflatten(flat)
