"""A planner that keeps a margin: it plans for a harder instance nearby, for example round a larger sphere.

A network's plans are off by some centimetres, and an optimal plan touches its constraint, so a network's plans often
enter the sphere a little. The remedy that Tang & Hauser (2019) name is a margin on the modelled obstacle; its price is
the longer path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.owner import plans_of
from moe_policy.protocols import Planner
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.checks import check_number
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


@checked
@dataclass(frozen=True)
class Margin:
    """A margin on a constraint: plans are made for a larger ``parameter``, such as ``"radius"``, by ``amount``.

    The amount has the parameter's unit; a TypeError or a ValueError where it is no finite number.
    """

    parameter: str
    amount: float

    def __post_init__(self) -> None:
        check_number("amount", self.amount)


class WithMargin:
    """Plans of ``planner`` for parameters of which one is larger by ``margin``.

    Beyond the parameter box the planner extrapolates.

    Args:
        problem: what is planned for.
        planner: the planner.
        parameter: name of the parameter that is enlarged, such as ``"radius"``: one of the context, since with another
            initial state the plan would not begin where it should.
        margin: by how much, in the parameter's unit.
        name: short name for tables; by default that of the planner with the margin.
    """

    @checked
    def __init__(
        self, problem: ProblemOrId, planner: Planner, parameter: str, margin: float, name: str | None = None
    ) -> None:
        problem = problem_of(problem)
        if parameter not in problem.context.names or parameter not in problem.parameters.names:
            raise ValueError(f"expected a parameter of the context {problem.context.names}, got {parameter!r}")
        check_number("margin", margin)
        self.problem, self.planner, self.margin = problem, planner, margin
        self.name = name or f"{getattr(planner, 'name', 'planner')}, {parameter} + {margin:g}"
        self._shift = margin * (np.array(problem.parameters.names) == parameter)

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), in any turn, made for the parameters with the margin added."""
        within, turns = self.problem.in_one_turn(p)
        return plans_of(self.planner, within + self._shift).shifted(turns)
