"""The fingerprint of a problem: a hash by which databases and weights are refused for another problem."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


def _digits(values: Array) -> list[str]:
    return [f"{v:.6e}" for v in np.ravel(values)]


def _further(problem: OptimalControlProblem, contexts: Array) -> list[object]:
    """What a problem has beyond a single goal state, a cost rate and clearances, at ``contexts`` (B, nc).

    Nothing for those that have no more, so that their fingerprints, which stand in files, stay the same.
    """
    terminal, parts = problem.terminal, list[object]()
    rng = np.random.Generator(np.random.Philox(key=20190622))
    x, u = (box.draw(rng, len(contexts)) for box in (problem.system.state, problem.system.control))
    if not terminal.plain or problem.goal.tolerance is not None:
        ends = [*terminal.bounds(contexts), terminal.error(x, contexts), terminal.controls(contexts)]
        parts += [["goal", *map(_digits, ends)]]
    if problem.terminal_cost is not None:
        parts += [["terminal_cost", _digits(problem.functions.terminal_cost()(x, contexts)[0])]]
    if sum(problem.n_mixed):
        parts += [["mixed", *map(_digits, problem.functions.mixed()(x, u, contexts))]]
    if problem.planned:
        parts += [["planned", *sorted(problem.planned.items())]]
    if problem.clearance_points > 1:
        parts += [["clearance_points", problem.clearance_points]]
    if not problem.horizon.numeric:
        parts += [["duration", _digits(problem.horizon.of(contexts))]]
    if callable(problem.parametrisation.rest):
        parts += [["rest", _digits(problem.parametrisation.rest(contexts))]]
    return parts


def fingerprint(problem: OptimalControlProblem) -> str:
    """16 hexadecimal digits that a file must carry to belong to ``problem``.

    A hash of the boxes, the goal and the discretisation, and of the functions through their values at fixed points,
    rounded to seven significant digits: equal for equal mathematics, whatever expressions CasADi makes of it.
    """
    system, goal, generator = problem.system, problem.goal, np.random.Generator(np.random.Philox(key=20190622))
    x, u, s = (box.draw(generator, 16) for box in (system.state, system.control, problem.context))
    values = [*problem.functions.rate()(x, u, s)]
    if problem.n_clearances:
        values += problem.functions.clearances()(x, s)
    digits = [[f"{v:.6e}" for v in np.ravel(value)] for value in values]
    boxes = [
        [(c.name, c.lower, c.upper, c.period) for c in box.coordinates]
        for box in (system.state, system.control, problem.parameters)
    ]
    windings = goal.windings_of(system.nx).tolist()
    ends = [problem.terminal.central_state.tolist(), goal.radius, windings]
    grid = problem.duration if problem.horizon.numeric else (), problem.knots, problem.substeps
    rest = problem.parametrisation.rest
    text = repr(
        (problem.id, boxes, ends, *grid, [] if callable(rest) else rest.tolist(), digits, *_further(problem, s))
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]
