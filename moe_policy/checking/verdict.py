"""What is known of a checked plan, and of a batch of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from moe_policy.checking.forecast import SLACK, Predicted
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Bools
from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat
from ocp_envs.trajectory import Trajectory

#: How a plan was made: a candidate as it was predicted, one that the solver improved by a few iterations, a solution of
#: the solver, or none at all.
How: TypeAlias = Literal["chosen", "repaired", "solved", "abstained"]
HOW: tuple[How, ...] = ("chosen", "repaired", "solved", "abstained")


@checked
@dataclass(frozen=True)
class Verdict:
    """What is known of one plan before it is flown.

    Args:
        how: how the plan was made.
        source: name of the planner whose plan it is, or was at first.
        verified: in the model the tracked plan reaches the goal at its end, terminal regulation keeps the state there,
            and all constraints are kept all the time.
        cost: predicted ∫L dt up to the first entry into the goal ball.
        clearance: smallest predicted clearance of the path constraints, in their unit; +inf without any.
        final_error: predicted ‖x − goal‖ at the plan's end.
        milliseconds: duration of planning and checking; of a batch, the instance's part of each step.
        reason: why the plan is not verified, in a sentence; empty if it is.
    """

    how: How
    source: str
    verified: bool
    cost: AnyFloat
    clearance: AnyFloat
    final_error: AnyFloat
    milliseconds: float
    reason: str


@checked
@dataclass(frozen=True, eq=False)
class CheckedPlans:
    """B plans, ``trajectory``, and a verdict on each, ``verdicts``."""

    trajectory: Trajectory
    verdicts: tuple[Verdict, ...]

    def __repr__(self) -> str:
        made = ", ".join(f"{self.count(how)} {how}" for how in HOW)
        return f"<CheckedPlans of {len(self)}: {int(self.verified.sum())} verified; {made}>"

    def __len__(self) -> int:
        return len(self.verdicts)

    @property
    def verified(self) -> Bools:
        """Which plans are verified, (B,)."""
        return np.array([verdict.verified for verdict in self.verdicts], dtype=bool)

    def count(self, how: How) -> int:
        """Number of plans that were made in this way, ``how``."""
        return sum(verdict.how == how for verdict in self.verdicts)


def reason_of(problem: OptimalControlProblem, predicted: Predicted) -> str:
    """Why the one plan of ``predicted`` does not solve its instance of ``problem``; empty if it does."""
    if predicted.success[0]:
        return ""
    if predicted.rejected[0]:
        return "there is no plan that is finite"
    if predicted.left_box[0]:
        return "the state leaves its operating box"
    reasons = []
    if (clearance := predicted.clearance[0]) < 0:
        reasons.append(f"the path enters a constraint by {-clearance:.3g}")
    elif problem.n_clearances and clearance < np.inf and predicted.final_error[0] < problem.goal.radius:
        reasons.append(f"the path comes as close to a constraint as {clearance:.3g}")
    if (error := predicted.final_error[0]) >= problem.goal.radius * (1 - SLACK):
        reasons.append(f"the plan ends {error:.3g} from the goal, whose radius is {problem.goal.radius:g}")
    return " and ".join(reasons) or "terminal regulation does not keep the state at the goal"
