"""A planner whose plans are repaired: the solver begins at each plan and improves it.

A network's plan nearly solves its nonlinear program: it violates the dynamics, the goal and the path constraints by a
few centimetres. A few iterations of an interior-point method from there remove most of this, in a fraction of the time
of a solve from nothing. The same iterations correct a plan for a plant whose constants differ from those of the model.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.owner import planned_problem, plans_of
from moe_policy.protocols import Planner
from ocp_envs.problems import ProblemOrId
from ocp_envs.solvers.improvement import improve
from ocp_envs.support.checks import check_number, check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


class Repaired:
    """Plans of ``planner``, each improved by the solver: by default one whole solve that begins at the plan.

    Every repaired plan begins at the initial state of its instance. Where the solver breaks down on a plan, the plan
    stays as it was; a plan that is not finite stays so. The solver runs in a process that this one keeps; threads that
    share a planner use as many as there are cores.

    Args:
        planner: the planner.
        iterations: at most so many iterations of the solver; ``None`` until it converges.
        margin: what the path constraints have to be at least at the knots, in their unit, and at most what they are at
            the initial state and at the goal. It keeps the path between the knots clear, too, at the price of a longer
            path.
        problem: what is planned for; by default the ``problem`` of the planner.
        name: short name for tables; by default that of the planner with the number of iterations, the
            margin and the constants.

    Raises:
        TypeError: a planner that cannot be called, or no numbers.
        ValueError: a planner without a ``problem`` where none is given, or of another one; fewer than one iteration; a
            negative margin; or a constant that the problem does not have, or that is one of its parameters.
    """

    @checked
    def __init__(
        self,
        planner: Planner,
        iterations: int | None = None,
        *,
        margin: float = 0.0,
        constants: Mapping[str, float] | None = None,
        problem: ProblemOrId | None = None,
        name: str | None = None,
    ) -> None:
        self.problem = planned_problem(planner, problem)
        if iterations is not None:
            check_whole("iterations", iterations)
        check_number("margin", margin)
        if margin < 0:
            raise ValueError(f"margin: expected at least 0, got {margin}")
        self.planner, self.iterations, self.margin = planner, iterations, float(margin)
        self.constants = dict(constants or {})
        for constant, value in self.constants.items():
            check_number(f"constants: {constant}", value)
        self.problem.with_constants(**self.constants)  # refuses values with which the plant is not finite
        self._model = self.problem.with_varied(**{key: (value, value) for key, value in self.constants.items()})
        effort = "" if iterations is None else f", {iterations} iteration{'s' if iterations > 1 else ''}"
        distance = f", margin {margin:g}" if margin else ""
        plant = "".join(f", {constant} {value:g}" for constant, value in self.constants.items())
        self.name = name or f"{getattr(planner, 'name', 'planner')}, repaired{effort}{distance}{plant}"

    def __repr__(self) -> str:
        plant = f", constants={self.constants}" if self.constants else ""
        return f"Repaired({self.planner!r}, {self.iterations}, margin={self.margin:g}{plant})"

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn."""
        within, turns = self.problem.in_one_turn(p)
        plans = plans_of(self.planner, within)
        extended = np.column_stack([within, *(np.full(len(within), value) for value in self.constants.values())])
        return improve(self._model, extended, plans, self.iterations, self.margin).trajectory.shifted(turns)
