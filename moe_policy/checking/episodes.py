"""Tracked episodes, with terminal regulation where the plan succeeds.

They are compiled where there is a C compiler, else run with NumPy for all at once.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from moe_policy.control.tracking import Tracking, TrackingPolicy
from moe_policy.rollouts.ledger import Violations
from ocp_envs.envs.simulation import Simulator
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.clock import count_steps
from ocp_envs.support.kept import kept
from ocp_envs.support.programs import address, library

_PROGRAM = Path(__file__).with_name("episodes.c")


class Ended(NamedTuple):
    """How B episodes ended, each (B,).

    The ``cost`` up to the first entry into the goal ball, the ``error`` at the plan's end, the smallest ``clearance``
    on the way, whether the state ``left_box``, and whether it ``stayed`` in the goal ball until the evaluation.
    Terminal regulation is run where the plan ends at the goal and is clear.
    """

    cost: Array
    error: Array
    clearance: Array
    left_box: Bools
    stayed: Bools


def compiled(plant: OptimalControlProblem, step: ca.Function) -> ctypes.CDLL | None:
    """The program that runs episodes of ``plant``, whose control step is ``step``; ``None`` where it cannot be."""
    return _kernel(plant, step, os.environ.get("CC"), os.environ.get("PATH"))


@kept
def _kernel(
    plant: OptimalControlProblem, step: ca.Function, compiler: str | None, path: str | None
) -> ctypes.CDLL | None:
    """The program as a library; the environment variables say which ``compiler`` there is on the ``path``."""
    system = plant.system
    sizes = {"NX": system.nx, "NU": system.nu, "NC": len(plant.context), "NH": plant.n_clearances}
    clearances = [plant.batch_clearances().function] if plant.n_clearances else []
    return library(_PROGRAM, [step, *clearances], sizes)


def run_compiled(
    program: ctypes.CDLL, problem: OptimalControlProblem, dt: float, states: Array, contexts: Array, tracking: Tracking
) -> Ended:
    """Episodes of ``problem`` with control steps of ``dt`` seconds by the compiled ``program``.

    They begin at ``states`` (B, nx) in ``contexts`` (B, nc) with the recurrent state ``tracking``.
    """
    goal, box, schedule = problem.goal, problem.system.control, tracking.schedule
    end, out = np.array(states, dtype=np.float64), np.empty((len(states), 5))
    fixed = (goal.state, problem.system.state.periods, box.lower, box.upper)
    held = [*map(np.ascontiguousarray, fixed), end]
    held += [
        np.ascontiguousarray(each)
        for each in (contexts, tracking.states, tracking.controls, tracking.gains, tracking.norms, schedule.knot_step)
    ]
    steps, evaluations = map(np.ascontiguousarray, _steps(problem, dt, tracking))
    program.run(
        ctypes.c_longlong(len(states)),
        ctypes.c_longlong(tracking.states.shape[1]),
        address(steps),
        address(evaluations),
        *map(ctypes.c_double, (dt, goal.radius, float(problem.knots))),
        *map(address, held),
        address(out),
    )
    cost, error, clearance, left, stayed = np.ascontiguousarray(out.T)
    return Ended(cost, error, clearance, left > 0, stayed > 0)


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
    error = at_end = problem.goal_error(x)
    cost, entered, left, none = np.zeros(size), error < radius, np.zeros(size, bool), np.zeros(size, bool)
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
        left |= running & result.left_box
        error = np.where(running, problem.goal_error(result.states), error)
        at_end = np.where(planned, error, at_end)
        entered |= running & (error < radius) & ~left
        x = np.where(running[:, None], result.states, x)
    return Ended(cost, at_end, path.clearance, left, error < radius)
