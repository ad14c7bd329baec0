"""What a network planner calculates around its network, as arrays: for exports in other languages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ocp_envs.support.arrays import Array, Bools

if TYPE_CHECKING:
    from moe_policy.planners.network import NetworkPlanner


class PlannerArrays(NamedTuple):
    """Arrays of a planner, with the angles of p (np,) written in the turn from ``first`` to ``end``.

    An angle outside of it is t = low + mod(p − low, period), less a period where t ≥ end. The network's input is
    (p − input_mean) / input_std, and the plan its output × output_std + output_mean, plus the turns that were taken off
    p, times ``into_plan`` (np, flat_size). Without angles, ``periodic`` is all false and the turns are 0.
    """

    periodic: Bools
    first: Array
    end: Array
    low: Array
    period: Array
    into_plan: Array
    input_mean: Array
    input_std: Array
    output_mean: Array
    output_std: Array

    @classmethod
    def of(cls, planner: NetworkPlanner) -> PlannerArrays:
        """Those of ``planner``."""
        problem, (periods, first, end) = planner.problem, planner.problem.parametrisation.turn
        in_state, slots, _ = problem.parametrisation.slots
        knots = np.arange(problem.knots)[:, None] * problem.system.nx
        into_plan = np.zeros((len(problem.parameters), problem.flat_size))
        for component, slot in zip(in_state, slots):
            into_plan[component, knots + slot] = 1.0
        return cls(
            periodic=periods > 0,
            first=first,
            end=end,
            low=problem.parameters.centre - periods / 2,
            period=np.where(periods > 0, periods, 1.0),
            into_plan=into_plan,
            input_mean=planner.inputs.mean,
            input_std=planner.inputs.std,
            output_mean=planner.outputs.mean,
            output_std=planner.outputs.std,
        )
