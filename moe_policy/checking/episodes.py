"""Tracked episodes, with terminal regulation where the plan succeeds.

They are compiled where there is a C compiler, else run with NumPy for all at once.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from moe_policy.control.program import STEP
from moe_policy.control.step import Tracking, box_arrays
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.rollouts.ledger import Violations
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints, address, pointers
from ocp_envs.support.clock import count_steps
from ocp_envs.support.kept import kept
from ocp_envs.support.programs import entry, library

_PROGRAM = Path(__file__).with_name("episodes.c")


class Ended(NamedTuple):
    """How B episodes ended, each (B,).

    The ``cost`` up to the first entry into the goal ball, the ``error`` at the plan's end, the smallest ``clearance``
    on the way, whether the state ``left_box``, whether it ``stayed`` in the goal ball until the evaluation, and the
    ``total`` cost up to the plan's end. Terminal regulation is run where the plan ends at the goal and is clear.
    """

    cost: Array
    error: Array
    clearance: Array
    left_box: Bools
    stayed: Bools
    total: Array


def compiled(plant: OptimalControlProblem, step: ca.Function) -> Callable[..., None] | None:
    """The program that runs episodes of ``plant``, whose control step is ``step``; ``None`` where it cannot be.

    It knows goals that are one state, reached at any time, and no terminal cost.
    """
    if (
        plant.horizon.fixed
        or plant.terminal_cost is not None
        or not plant.terminal.plain
        or plant.goal.tolerance is not None
    ):
        return None
    return _kernel(plant, step, os.environ.get("CC"), os.environ.get("PATH"))


@kept
def _kernel(
    plant: OptimalControlProblem, step: ca.Function, compiler: str | None, path: str | None
) -> Callable[..., None] | None:
    """``run`` of ``episodes.c``; the environment variables say which ``compiler`` there is on the ``path``."""
    system = plant.system
    sizes = {"NX": system.nx, "NU": system.nu, "NC": len(plant.context), "NH": plant.n_clearances}
    clearances = [plant.functions.clearances().function] if plant.n_clearances else []
    made = library([STEP, _PROGRAM], [step, *clearances], sizes)
    return None if made is None else entry(made, "run", "qqppdddppppppp")


def run_compiled(
    program: Callable[..., None],
    problem: OptimalControlProblem,
    dt: float,
    states: Array,
    contexts: Array,
    tracking: Tracking,
) -> Ended:
    """Episodes of ``problem`` with control steps of ``dt`` seconds by the compiled ``program``.

    They begin at ``states`` (B, nx) in ``contexts`` (B, nc) with the recurrent state ``tracking``.
    """
    goal, schedule = problem.goal, tracking.schedule
    steps, evaluations = map(np.ascontiguousarray, _steps(problem, dt, tracking))
    # Named, so that they live until the program returns.
    boxes, target = [np.ascontiguousarray(each) for each in box_arrays(problem)], problem.terminal.central_state
    end, out = np.array(states, dtype=np.float64), np.empty((len(states), 6))
    given, knot_step = np.ascontiguousarray(contexts), np.ascontiguousarray(schedule.knot_step)
    program(
        len(states),
        tracking.states.shape[1],
        address(steps),
        address(evaluations),
        dt,
        goal.radius,
        float(problem.knots),
        address(target),
        pointers(boxes),
        address(end),
        address(given),
        tracking.pointers,
        address(knot_step),
        address(out),
    )
    cost, error, clearance, left, stayed, total = np.ascontiguousarray(out.T)
    return Ended(cost, error, clearance, left > 0, stayed > 0, total)


def _steps(problem: OptimalControlProblem, dt: float, tracking: Tracking) -> tuple[Ints, Ints]:
    """The control steps at which plans end, and at which they are evaluated, (B,)."""
    limit = count_steps(problem.time_limit, dt)
    times = (tracking.schedule.plan_end, tracking.schedule.evaluation)
    end, evaluation = (np.minimum(count_steps(time, dt), limit) for time in times)
    return end, evaluation


def run(policy: TrackingPolicy, simulator: Simulator, states: Array, contexts: Array, tracking: Tracking) -> Ended:
    """Episodes of ``policy`` in the ``simulator``, from ``states`` (B, nx) in ``contexts`` (B, nc).

    They begin with the recurrent state ``tracking``.
    """
    problem, schedule, x = policy.problem, tracking.schedule, states
    size, radius = len(x), problem.goal.radius
    ends, evaluations = _steps(problem, policy.dt, tracking)
    path = Violations(problem, policy.dt, x, contexts, schedule.knot_step)
    error = at_end = problem.goal_error(x, contexts)
    earliest = ends if problem.horizon.fixed else np.zeros_like(ends)
    cost, total, entered, left, none = (
        np.zeros(size),
        np.zeros(size),
        (error < radius) & (earliest == 0),
        np.zeros(size, bool),
        np.zeros(size, bool),
    )
    for step in range(1, int(evaluations.max(initial=0)) + 1):
        planned = step <= ends
        regulated = ~planned & (step <= evaluations) & (at_end < radius) & (path.clearance > 0)
        running = (planned | regulated) & ~left
        if not running.any():
            break
        observed = np.concatenate([x, contexts], axis=1).astype(np.float32)
        controls, tracking = policy.act(observed, tracking, none)
        result = simulator.advance(x, controls, contexts)
        path.add(step, running, x, result.states)
        cost += np.where(running & ~entered, result.cost, 0.0)
        total += np.where(running & planned, result.cost, 0.0)
        left |= running & result.left_box
        error = np.where(running, problem.goal_error(result.states, contexts), error)
        at_end = np.where(planned, error, at_end)
        enters = running & ~entered & ~left & (error < radius) & (step >= earliest)
        if problem.terminal_cost is not None:
            (terminal,) = problem.functions.terminal_cost()(result.states, contexts)
            total += np.where(running & (step == ends), terminal[:, 0], 0.0)
            cost += np.where(enters | (running & ~entered & ~left & (step == evaluations)), terminal[:, 0], 0.0)
        entered |= enters
        x = np.where(running[:, None], result.states, x)
    return Ended(cost, at_end, path.clearance, left, error < radius, total)
