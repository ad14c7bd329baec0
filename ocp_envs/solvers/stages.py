"""The functions of one stage of a transcribed program, scaled; and the scale of its cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ocp_envs.points import points_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


def cost_scale(problem: OptimalControlProblem) -> float:
    """The power of 100 that brings a typical cost of ``problem`` to between 1 and 100.

    Typical is the median of the cost rate at initial states with the goal's control, or in the box where it is zero
    there, over half the longest duration; and of the differences of the terminal cost from its median at the goal, or
    at initial states or in the box, where that is larger. A constant in the terminal cost changes nothing.
    """
    at_goal, at_starts, in_box = points_of(problem)
    typical = _median([problem.functions.rate()(at.states, at.controls, at.contexts)[1] for at in (at_starts, in_box)])
    typical *= problem.horizon.longest / 2
    if problem.terminal_cost is not None:
        ends = (at_goal, at_starts, in_box)
        costs = [problem.functions.terminal_cost()(at.states, at.contexts)[0] for at in ends]
        finite = [each[np.isfinite(each)] for each in costs]
        typical = max(typical, _median([each - np.median(each) for each in finite if len(each)]))
    return float(100.0 ** np.floor(np.log10(typical) / 2)) if typical > 0 else 1.0


def _median(sets: Sequence[Array]) -> float:
    """The median magnitude in the first of ``sets`` that has values other than 0; 0 without any."""
    for values in sets:
        magnitude = np.abs(values)
        usable = magnitude[np.isfinite(magnitude) & (magnitude > 0)]
        if len(usable):
            return float(np.median(usable))
    return 0.0


class Stages(NamedTuple):
    """The scaled functions of one stage, see :class:`~ocp_envs.solvers.transcription.Transcription`."""

    interval: ca.Function
    clearance: ca.Function
    mixed: ca.Function
    final: ca.Function

    @classmethod
    def of(cls, problem: OptimalControlProblem, centre: Array, step_scale: float, per_cost: float) -> Stages:
        system, formulation = problem.system, problem.formulation
        x, u, s = problem.symbols()
        h = ca.SX.sym("h")
        scale = ca.DM(system.state.scale)
        state, control = x * scale, u * ca.DM(system.control.scale) + ca.DM(centre)
        following, cost = formulation.flow(state, control, s, h * step_scale, problem.substeps)
        z = ca.vertcat(x, h, u)
        inequalities, equalities = formulation.mixed(state, control, s)
        mixed = ca.vertcat(inequalities, formulation.between(state, control, s, h * step_scale), equalities)
        final = ca.vertcat(*problem.terminal.constraints(state, s))
        end = formulation.terminal_cost(state, s) / per_cost
        return cls(
            ca.Function("interval", [z, s], [ca.vertcat(following / scale, h), cost / per_cost]),
            ca.Function("clearances", [x, s], [problem.clearances(state, s)]),
            ca.Function("mixed", [z, s], [mixed]),
            ca.Function("final", [x, s], [final, end]),
        )
