"""A planner that uses the symmetry of its problem, which a trained network does not respect exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.planners.owner import plans_of
from moe_policy.protocols import Planner
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

#: Largest difference of two plans of one family, in units of the coordinates' scales.
AGREEMENT = 0.5


class Symmetrised:
    """The mean of a plan and of the mirror image of the plan for the mirrored instance.

    Both predict the same trajectory, with different errors. Where they differ by more than such errors, they belong to
    different solution families, whose mean is not a plan. There one of them is taken: the one that was planned for the
    instance whose parameters come first in lexicographic order. The plan for a mirrored instance is therefore the
    mirror image of the plan, except where an instance is its own mirror image and the families differ.

    Args:
        problem: a problem with a ``symmetry``, else a ValueError is raised.
        planner: the planner.
        name: short name for tables; by default that of the planner and of the symmetry.
    """

    @checked
    def __init__(self, problem: ProblemOrId, planner: Planner, name: str | None = None) -> None:
        problem = problem_of(problem)
        if problem.symmetry is None:
            raise ValueError(f"{problem.id} declares no symmetry")
        self.problem, self.planner, self.symmetry = problem, planner, problem.symmetry
        self.name = name or f"{getattr(planner, 'name', 'planner')}, {self.symmetry.name}"

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn."""
        problem, symmetry = self.problem, self.symmetry
        parameters, turns = problem.in_one_turn(p)
        states, contexts = problem.start(parameters)
        mirrored, back = problem.in_one_turn(
            problem.parameters_of(symmetry.states(states), symmetry.contexts(contexts))
        )
        plan = plans_of(self.planner, parameters)
        other = symmetry.trajectories(plans_of(self.planner, mirrored).shifted(back))
        apart = np.abs(plan.states - other.states) / problem.system.state.scale
        agree = apart.max(axis=(1, 2)) < AGREEMENT
        one = np.where(_comes_first(mirrored, parameters)[:, None], other.flat(), plan.flat())
        mean = np.where(agree[:, None], (plan.flat() + other.flat()) / 2, one)
        return problem.unflatten(mean).shifted(turns)


def _comes_first(a: Array, b: Array) -> Bools:
    """Whether rows of ``a`` (B, n) come before those of ``b`` in lexicographic order, (B,); equal ones do not."""
    first = (a != b).argmax(axis=1)[:, None]
    return np.asarray(np.take_along_axis(a, first, 1) < np.take_along_axis(b, first, 1))[:, 0]
