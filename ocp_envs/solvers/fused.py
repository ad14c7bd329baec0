"""The functions of one stage of a transcribed program, each with all derivatives in one function.

They are what the C of the interior-point method calls (``recursion.c``), as kernels that evaluate several stages at
once. Values and derivatives share their subexpressions; matrices are dense and, as C has them, stored by rows.
"""

from __future__ import annotations

import casadi as ca

from ocp_envs.solvers.transcription import Transcription

#: Longer intervals have derivatives that take minutes to compile: 40,000 instructions for those of the quadcopters.
MOST_INSTRUCTIONS = 1000


def stage_functions(program: Transcription) -> list[ca.Function]:
    """The functions of a stage of ``program`` with z = (x, h, u), the context s and multipliers λ and y.

    These are ``stage``, z, s, λ, y → F, cost, constraints c, gradients of the cost and of cost + λᵀF − yᵀc, Jacobians
    of F and c, second derivatives of cost + λᵀF − yᵀc; the same without dynamics for the last state, ``end``, z, s, y;
    and their values alone, ``stage_values`` and ``end_values``.
    """
    z, s = (ca.SX.sym(name, program.interval.size1_in(i)) for i, name in enumerate(("z", "s")))
    states = z[: program.nx]
    following, cost = program.interval(z, s)
    clearances, (final, end_cost) = program.clearance(states, s), program.final(states, s)
    within, at_end = ca.vertcat(clearances, program.mixed(z, s)), ca.vertcat(clearances, final)
    multipliers, y, y_end = (ca.SX.sym("m", each.numel()) for each in (following, within, at_end))
    stage = [following, *_derived(z, cost, within, y, ca.dot(multipliers, following))]
    stage.insert(-2, ca.jacobian(following, z).T)
    return [
        _function("stage", [z, s, multipliers, y], stage),
        _function("stage_values", [z, s], [following, cost, within]),
        _function("end", [z, s, y_end], _derived(z, end_cost, at_end, y_end, ca.SX(0))),
        _function("end_values", [z, s], [end_cost, at_end]),
    ]


def _derived(z: ca.SX, cost: ca.SX, constraints: ca.SX, y: ca.SX, dynamics: ca.SX) -> list[ca.SX]:
    """``cost``, ``constraints``, both gradients, and the derivatives of the constraints and of the Lagrangian."""
    hessian, gradient = ca.hessian(cost + dynamics - ca.dot(y, constraints), z)
    return [cost, constraints, ca.gradient(cost, z), gradient, ca.jacobian(constraints, z).T, hessian]


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, inputs, ca.cse([ca.densify(output) for output in outputs]))
