"""A problem's functions, tried at a few points when the problem is declared.

What makes a problem unsolvable, or its solution wrong, is refused here: values and derivatives that are not finite,
parameters that nothing reads, a goal that cannot be held, windings without a family. What may be intended is told in a
warning.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ocp_envs.holding import check_equilibrium, check_pinned, check_stabilisable
from ocp_envs.points import Points, points_of, warn
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.batch import BatchFunction, dense_function
from ocp_envs.support.suggestions import did_you_mean
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    from ocp_envs.problem import OptimalControlProblem
    from ocp_envs.system import Expression


@dataclass(frozen=True, eq=False)
class Functions:
    """ẋ, L and h of a problem as one column ``values`` of the symbols ``x``, ``u`` and ``s``, with a name for each.

    The first ``on_path`` of them matter along trajectories, the others, φ, only where they end. ``ends`` is what the
    goal, the duration and the initial values say, in ``x`` and ``s``. ``read`` are the names of the constants that the
    declaration reads.
    """

    names: tuple[str, ...]
    x: Expression
    u: Expression
    s: Expression
    values: Expression
    ends: Expression
    on_path: int
    read: frozenset[str]

    @classmethod
    def of(cls, problem: OptimalControlProblem) -> Functions:
        """Those of ``problem``; a ``ValueError`` says which of them fails, or returns something else."""
        x, u, s = problem.symbols()
        formulation = problem.formulation
        context, constants, _ = formulation.namespaces(s)
        parts = [formulation.rate_of(x, u, context, constants), formulation.clearances_of(x, context, constants)]
        names = [f"dynamics: the derivative of {name!r}" for name in problem.system.state.names] + ["cost_rate"]
        others = dict(zip(("inequalities", "equalities"), formulation.mixed_of(x, u, context, constants)))
        for name, part in {"clearance": parts[1], **others}.items():
            names += [f"{name}: component {i}" for i in range(part.shape[0])]
        parts += others.values()
        on_path = len(names)
        if problem.terminal_cost is not None:
            names.append("terminal_cost")
            parts.append(formulation.terminal_cost_of(x, context, constants))
        ends = [problem.terminal.expression(x, s), formulation.durations(s)]
        if callable(problem.rest):
            ends.append(formulation.rest(s))
        return cls(tuple(names), x, u, s, ca.vertcat(*parts), ca.vertcat(*ends), on_path, formulation.constants_read)

    def evaluate(self, *sets: Points) -> list[tuple[Array, Array]]:
        """Values (M, m) and derivatives with respect to (x, u), (M, m, nx + nu), at each set of points."""
        jacobian = ca.jacobian(self.values, ca.vertcat(self.x, self.u))
        function = BatchFunction(dense_function("trial", [self.x, self.u, self.s], [self.values, jacobian]))
        with np.errstate(all="ignore"):
            results = [function(points.states, points.controls, points.contexts) for points in sets]
        return [(values, derivatives) for values, derivatives in results]


def check_values(problem: OptimalControlProblem, functions: Functions, values: Array, where: Points) -> Bools:
    """Refuse a ``problem`` with a function that is finite at none of the points ``where``.

    Its ``functions`` have the ``values`` (M, m) there. Returned is which of these are finite, (M, m).
    """
    finite = np.isfinite(values)
    for i in np.flatnonzero(~finite.any(axis=0)):
        raise ValueError(
            f"{problem.id}: {functions.names[i]} is {values[0, i]:g} {where.called} ({where.text(problem, 0)}); "
            "write it so that it is finite there, with CasADi's functions (ca.sin, not math.sin)"
        )
    return np.asarray(finite)


def warn_of_values(problem: OptimalControlProblem, functions: Functions, finite: Bools, where: Points) -> None:
    """Warn of a ``problem`` whose ``functions`` are not ``finite`` (M, m) at some of the points ``where``."""
    for i in np.flatnonzero(~finite.all(axis=0))[:1]:
        row = int(np.flatnonzero(~finite[:, i])[0])
        warn(
            f"{problem.id}: {functions.names[i]} is not finite at {int((~finite[:, i]).sum())} of {len(finite)} points "
            f"{where.called}, such as {where.text(problem, row)}; guesses and simulations that come there fail"
        )


def check_derivatives(problem: OptimalControlProblem, functions: Functions, derivatives: Array, where: Points) -> None:
    """Refuse a ``problem`` whose ``functions`` have no finite ``derivatives`` (M, m, nx + nu) ``where`` its goal is.

    Neither the solver nor a regulator can work there.
    """
    broken = ~np.isfinite(derivatives).any(axis=0)
    for i, j in np.argwhere(broken):
        name = (*problem.system.state.names, *problem.system.control.names)[j]
        raise ValueError(
            f"{problem.id}: the derivative of {functions.names[i]} with respect to {name!r} is "
            f"{derivatives[0, i, j]:g} {where.called} ({where.text(problem, 0)}), where optimal trajectories end; "
            "smooth it there, for instance ca.sqrt(a + 1e-6) instead of ca.sqrt(a)"
        )


def check_reads(problem: OptimalControlProblem, functions: Functions) -> None:
    """Refuse parameters, and warn of constants, that none of the ``functions`` of ``problem`` reads."""
    system = problem.system
    known = [*system.state.names, *system.constants]
    if len(problem.context):
        read = ca.which_depends(ca.vertcat(functions.values, functions.ends), functions.s, 1, False)
        for name in (name for name, used in zip(problem.context.names, read) if not used):
            others = [each for each in known if each not in problem.parameters.names]
            raise ValueError(
                f"{problem.id}: nothing depends on the parameter {name!r}; {did_you_mean(name, others)}a parameter has "
                f"the name of a state coordinate {list(system.state.names)} or of a constant "
                f"{list(system.constants)}, or it is read as a coordinate of the context"
            )
    unread = [name for name in system.constants if name not in functions.read]
    if unread:
        warn(f"{problem.id}: none of the functions reads the constants {unread}; remove them")


def check_clear(problem: OptimalControlProblem, values: Array) -> None:
    """Refuse a ``problem`` whose goal violates a path constraint, where no context can change that.

    The ``values`` (M, m) of its functions are those at the goal.
    """
    first = problem.system.nx + 1
    for i, h in enumerate(values[0, first : first + problem.n_clearances]):
        if not len(problem.context) and problem.terminal.pinned and h < 0:
            raise ValueError(
                f"{problem.id}: the goal violates the path constraint, clearance component {i} is {h:g} there, and has "
                "to be ≥ 0; move the goal or the constraint"
            )


def check_modes(problem: OptimalControlProblem) -> None:
    """Refuse a ``problem`` whose ``modes`` give a straight line to one of its targets no family."""
    count, knots = len(problem.targets), problem.knots
    p = np.tile(problem.parameters.centre, (count, 1))
    starts, _ = problem.start(p)
    progress = np.linspace(0.0, 1.0, knots)[:, None]
    states = starts[:, None] + progress * (problem.targets - starts)[:, None]
    held = problem.terminal.controls(problem.start(p)[1])
    lines = Trajectory(states, np.repeat(held[:, None], knots - 1, axis=1), np.full(count, problem.horizon.longest))
    problem.modes.of(problem, p, lines, np.zeros((count, knots, problem.n_clearances)))


def check(problem: OptimalControlProblem, nominal: bool = True) -> None:
    """Try the functions of ``problem``.

    Args:
        problem: the problem.
        nominal: whether it is a problem as declared, so that also what the goal, the parameters and the constants are
            for is checked; a plant with other constants may be one that does not rest at the goal.

    Raises:
        ValueError: what makes the problem unsolvable; the message names the function and the component.
    """
    functions = Functions.of(problem)
    sets = points_of(problem)
    (at_goal, derivatives), *others = functions.evaluate(*sets)
    check_values(problem, functions, at_goal, sets[0])
    at_starts, in_box = (values[:, : functions.on_path] for values, _ in others)
    finite = check_values(problem, functions, at_starts, sets[1])
    if not nominal:
        return
    check_derivatives(problem, functions, derivatives, sets[0])
    check_reads(problem, functions)
    check_clear(problem, at_goal)
    if problem.hold > 0:
        check_pinned(problem)
        check_equilibrium(problem, at_goal, sets[0])
        check_stabilisable(problem, derivatives)
    check_modes(problem)
    if problem.symmetry is not None:
        problem.symmetry.check_invariance(problem)
    warn_of_values(problem, functions, finite, sets[1])
    warn_of_values(problem, functions, np.isfinite(in_box), sets[2])
