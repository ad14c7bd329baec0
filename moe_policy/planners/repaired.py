"""A planner whose plans are repaired: the solver begins at each plan and improves it.

A network's plan nearly solves its nonlinear program: it violates the dynamics, the goal and the path constraints by a
few centimetres. A few iterations of an interior-point method from there remove most of this, in a fraction of the time
of a solve from nothing.
"""

from __future__ import annotations

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
        name: short name for tables; by default that of the planner with the number of iterations and the margin.

    Raises:
        TypeError: a planner that cannot be called, or no numbers.
        ValueError: a planner without a ``problem`` where none is given, or of another one; fewer than one iteration; or
            a negative margin.
    """

    @checked
    def __init__(
        self,
        planner: Planner,
        iterations: int | None = None,
        *,
        margin: float = 0.0,
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
        effort = "" if iterations is None else f", {iterations} iteration{'s' if iterations > 1 else ''}"
        distance = f", margin {margin:g}" if margin else ""
        self.name = name or f"{getattr(planner, 'name', 'planner')}, repaired{effort}{distance}"

    def __repr__(self) -> str:
        return f"Repaired({self.planner!r}, {self.iterations}, margin={self.margin:g})"

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn."""
        within, turns = self.problem.in_one_turn(p)
        plans = plans_of(self.planner, within)
        return improve(self.problem, within, plans, self.iterations, self.margin).trajectory.shifted(turns)
