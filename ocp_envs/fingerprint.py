"""The fingerprint of a problem: a hash by which databases and weights are refused for another problem."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem


def fingerprint(problem: OptimalControlProblem) -> str:
    """16 hexadecimal digits that a file must carry to belong to ``problem``.

    A hash of the boxes, the goal and the discretisation, and of the functions through their values at fixed points,
    rounded to seven significant digits: equal for equal mathematics, whatever expressions CasADi makes of it.
    """
    system, goal, generator = problem.system, problem.goal, np.random.Generator(np.random.Philox(key=20190622))
    x, u, s = (box.draw(generator, 16) for box in (system.state, system.control, problem.context))
    values = [*problem.batch_rate()(x, u, s)]
    if problem.n_clearances:
        values += problem.batch_clearances()(x, s)
    digits = [[f"{v:.6e}" for v in np.ravel(value)] for value in values]
    boxes = [
        [(c.name, c.lower, c.upper, c.period) for c in box.coordinates]
        for box in (system.state, system.control, problem.parameters)
    ]
    ends = [goal.state.tolist(), goal.radius, goal.windings.tolist()]
    grid = problem.duration, problem.knots, problem.substeps
    text = repr((problem.id, boxes, ends, *grid, problem.parametrisation.rest.tolist(), digits))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
