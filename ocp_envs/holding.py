"""Whether terminal regulation can hold the goal of a problem, as the linearisation there shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ocp_envs.points import Points, warn
from ocp_envs.support.arrays import Array

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem

#: A goal counts as held if ẋ there, times the time of terminal regulation, is at most this fraction of its radius.
_DRIFT = 0.1
#: A mode of the linearisation at the goal with a real part above this, in 1/s, does not decay by itself.
_DECAY = -1e-4
#: Singular values below this, of matrices with entries of at most 1, count as 0.
_RANK = 1e-9


def check_pinned(problem: OptimalControlProblem) -> None:
    """Refuse terminal regulation of ``problem`` where its goal is not one state in each context."""
    terminal = problem.terminal
    if terminal.pinned:
        return
    free = [name for name, fixed in zip(problem.system.state.names, terminal.fixed) if not fixed]
    why = f"the final values of {free} are not fixed" if free else "it has alternatives or final constraints"
    raise ValueError(
        f"{problem.id}: hold = {problem.hold:g} s of terminal regulation needs a goal that is one state, but {why}; "
        "declare hold=0.0, so that success is evaluated at the end of the plan"
    )


def check_equilibrium(problem: OptimalControlProblem, values: Array, where: Points) -> None:
    """Refuse terminal regulation of ``problem`` at a goal that is an equilibrium in none of the contexts.

    The ``values`` (M, m) of its functions begin with ẋ and are those at the points ``where``, the goal in some
    contexts. A goal that is an equilibrium in some of them is told in a warning.
    """
    rates = values[:, : problem.system.nx]
    allowed = _DRIFT * problem.goal.radius / problem.hold
    moves = np.linalg.norm(rates / problem.goal.tolerance_of(rates.shape[1]), axis=1) > allowed
    if not moves.any():
        return
    row = 0 if moves.all() else int(np.flatnonzero(moves)[0])
    c = problem.system.state.coordinates[int(np.abs(rates[row]).argmax())]
    rate = f"the derivative of {c.name!r} is {np.abs(rates[row]).max():.3g} ({c.unit})/s"
    if moves.all():
        raise ValueError(
            f"{problem.id}: hold = {problem.hold:g} s of terminal regulation needs a goal that is an equilibrium, but "
            f"under goal.control {rate} there; correct goal.control or goal.state, or declare hold=0.0"
        )
    warn(
        f"{problem.id}: goal.control keeps the state at the goal only in some contexts; at {where.text(problem, row)} "
        f"{rate}, so that terminal regulation drifts off"
    )


def _uncontrollable(a: Array, b: Array) -> Array:
    """An orthonormal basis of the directions that no control reaches, (nx, k), of ẋ = A x + B u."""
    reached = np.zeros((len(a), 0))
    new = b
    while new.shape[1]:
        unit = new / (np.abs(new).max() or 1.0)
        u, sizes, _ = np.linalg.svd(np.hstack([reached, unit]), full_matrices=False)
        rank = int((sizes > _RANK).sum())
        if rank == reached.shape[1]:
            break
        reached, new = u[:, :rank], a @ u[:, :rank]
    u, _, _ = np.linalg.svd(np.hstack([reached, np.zeros((len(a), 1))]))
    return np.asarray(u[:, reached.shape[1] :])


def check_stabilisable(problem: OptimalControlProblem, derivatives: Array) -> None:
    """Refuse terminal regulation of ``problem`` at a goal where a mode neither decays nor can be controlled.

    The ``derivatives`` (M, m, nx + nu) of its functions with respect to (x, u) are those at the goal in some contexts.
    """
    nx, scale = problem.system.nx, problem.system.state.scale
    linear = derivatives[np.isfinite(derivatives[:, :nx]).all(axis=(1, 2)), :nx][0]
    a = linear[:, :nx] * scale / scale[:, None]
    b = linear[:, nx:] * problem.system.control.scale / scale[:, None]
    free = _uncontrollable(a, b)
    if not free.shape[1] or (np.linalg.eigvals(free.T @ a @ free).real < _DECAY).all():
        return
    names = [name for name, part in zip(problem.system.state.names, np.abs(free).max(axis=1)) if part > 0.1]
    raise ValueError(
        f"{problem.id}: hold = {problem.hold:g} s of terminal regulation needs a goal that a linear regulator can "
        f"hold, but no control moves {', '.join(names)} there, to first order, and their motion does not decay; "
        "declare hold=0.0, so that success is evaluated at the end of the plan, or choose another goal"
    )
