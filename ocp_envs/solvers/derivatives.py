"""Derivatives of a transcribed program, put together from those of one interval.

The program couples intervals linearly, so that its Lagrangian λ_f f + λᵀg has one block of second derivatives for each
stage, and its constraints one block of first derivatives for each interval. CasADi derives both in directions that it
finds for the whole program, at many times the arithmetic of those that are written out for one interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Ints


class WrittenOut(NamedTuple):
    """The ``functions`` by name that are compiled instead of those that CasADi derives; and the functions of one stage,
    ``stages``, which they and the program map over the stages.
    """

    functions: Mapping[str, ca.Function]
    stages: Sequence[ca.Function]


class _Entries(NamedTuple):
    """Entries of a sparse matrix: of each block, rows and columns (one pair of arrays each), and their values.

    Rows and columns of −1 are no variables: such entries are left out.
    """

    rows: Ints
    columns: Ints
    values: ca.MX

    def matrix(self, rows: int, columns: int) -> ca.MX:
        """The matrix (rows, columns) of these entries, no two of which have one place."""
        chosen = np.flatnonzero((self.rows >= 0) & (self.columns >= 0))
        order = chosen[np.lexsort((self.rows[chosen], self.columns[chosen]))]
        starts = np.searchsorted(self.columns[order], np.arange(columns + 1)).tolist()
        pattern = ca.Sparsity(rows, columns, starts, self.rows[order].tolist())
        return ca.MX(pattern, self.values.nz[order.tolist()])


def _joined(blocks: Iterable[_Entries]) -> _Entries:
    rows, columns, values = zip(*blocks)
    return _Entries(np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values))


class _Stage:
    """The functions of one stage: of z = (x, h, u), the context s, and multipliers of f and of the constraints."""

    def __init__(self, program: Transcription) -> None:
        nx, counts = program.nx, program.counts
        z, s = (ca.SX.sym(name, program.interval.size1_in(i)) for i, name in enumerate(("z", "s")))
        of_f, of_defect, of_clearance = ca.SX.sym("f"), ca.SX.sym("defect", nx + 1), ca.SX.sym("clearance", counts[0])
        of_mixed, of_final = ca.SX.sym("mixed", sum(counts.mixed)), ca.SX.sym("final", sum(counts.final))
        following, cost = program.interval(z, s)
        clearances, mixed = program.clearance(z[:nx], s), program.mixed(z, s)
        final, end_cost = program.final(z[:nx], s)
        self.gradient = ca.Function("stage_gradient", [z, s], [ca.densify(ca.gradient(cost, z))])
        self.end_gradient = ca.Function("end_gradient", [z, s], [ca.densify(ca.gradient(end_cost, z))])
        jacobian, clearance_jacobian = ca.jacobian(-following, z), ca.jacobian(clearances, z[:nx])
        self.mixed_jacobian, self.mixed_pattern = _nonzeros("mixed_jacobian", [z, s], ca.jacobian(mixed, z))
        self.final_jacobian, self.final_pattern = _nonzeros("final_jacobian", [z, s], ca.jacobian(final, z[:nx]))
        self.jacobian, self.jacobian_pattern = _nonzeros("stage_jacobian", [z, s], jacobian)
        self.clearance_jacobian, self.clearance_pattern = _nonzeros("clearance_jacobian", [z, s], clearance_jacobian)
        end = ca.dot(of_clearance, clearances)
        lagrangian = of_f * cost - ca.dot(of_defect, following) + end + ca.dot(of_mixed, mixed)
        hessian, gradient = ca.hessian(lagrangian, z)
        arguments = [z, s, of_f, of_defect, of_clearance, of_mixed]
        self.hessian, self.hessian_pattern = _nonzeros("stage_hessian", arguments, hessian, gradient)
        end_hessian, end_gradient = ca.hessian(end + ca.dot(of_final, final) + of_f * end_cost, z)
        arguments = [z, s, of_f, of_clearance, of_final]
        self.end_hessian, self.end_pattern = _nonzeros("end_hessian", arguments, end_hessian, end_gradient)


def _nonzeros(name: str, arguments: Sequence[ca.SX], matrix: ca.SX, *more: ca.SX) -> tuple[ca.Function, Ints]:
    """The function ``name`` of the nonzeros of a ``matrix``, and of ``more``; rows and columns (2, n) of the former."""
    outputs = [ca.vertcat(*matrix.nonzeros()), *(ca.densify(each) for each in more)]
    rows, columns = matrix.sparsity().get_triplet()
    return ca.Function(name, arguments, ca.cse(outputs)), np.array([rows, columns], dtype=np.int64).reshape(2, -1)


def _block(rows: Ints, columns: Ints, pattern: Ints, values: ca.MX) -> _Entries:
    """Entries of stages with the constraints ``rows`` (M, n), variables ``columns`` (M, nz) and one ``pattern``."""
    return _Entries(rows[:, pattern[0]].ravel(), columns[:, pattern[1]].ravel(), ca.vec(values))


def _of(multipliers: ca.MX, rows: Ints) -> ca.MX:
    """The ``multipliers`` of the constraints ``rows`` (M, n), (n, M)."""
    return ca.reshape(multipliers.nz[rows.ravel().tolist()], rows.shape[1], rows.shape[0])


def written_out(program: Transcription) -> WrittenOut:
    """The functions of ``program`` that CasADi's interface of fatrop calls for derivatives, and those of one stage."""
    x, p = ca.MX.sym("x", len(program.lower)), ca.MX.sym("p", program.nlp.numel_in("p"))
    of_f, of_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", program.nlp.numel_out("g"))
    stage, layout = _Stage(program), _Layout(program)
    z, s = layout.stages(x, p)
    _, g = program.nlp(x, p)
    jacobian = layout.jacobian(stage, z, s).matrix(of_g.numel(), x.numel())
    gradient, hessian = layout.lagrangian(stage, z, s, of_f, of_g)
    cost_gradient = stage.gradient.map(program.intervals)(z[:, :-1], s[:, :-1])
    # CasADi makes a constant zero of the function without a terminal cost.
    cost_gradient = ca.horzcat(cost_gradient, ca.densify(stage.end_gradient(z[:, -1], s[:, -1])))
    functions = {
        "nlp_grad_f": ca.Function("nlp_grad_f", [x, p], [layout.packed(cost_gradient)], ["x", "p"], ["grad_f_x"]),
        "nlp_jac_g": ca.Function("nlp_jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "nlp_hess_l": ca.Function(
            "nlp_hess_l",
            [x, p, of_f, of_g],
            [gradient, hessian.matrix(x.numel(), x.numel())],
            ["x", "p", "lam_f", "lam_g"],
            ["grad_gamma_x", "hess_gamma_x_x"],
        ),
    }
    of_stages = (stage.gradient, stage.jacobian, stage.clearance_jacobian, stage.mixed_jacobian, stage.hessian)
    return WrittenOut(functions, (program.interval, program.clearance, program.mixed, *of_stages))


class _Layout:
    """Where the variables and the constraints of the stages of ``program`` are."""

    def __init__(self, program: Transcription) -> None:
        self.program = program
        #: Index in w of each entry of (x, h, u) of each stage, −1 for what is no variable, (N, nz).
        self.variables = np.full(program.present.shape, -1, dtype=np.int64)
        self.variables[program.present] = np.arange(int(program.present.sum()))

    def stages(self, x: ca.MX, p: ca.MX) -> tuple[ca.MX, ca.MX]:
        """z (nz, N) and s (nc, N) of all stages, of the variables ``x`` and the parameters ``p``; 0 where none is."""
        nx = self.program.nx
        initial = p[:nx] / ca.DM(self.program.state_scale)
        source = ca.vertcat(x, initial, ca.MX(0))
        index = np.where(self.variables >= 0, self.variables, x.numel() + nx)
        index[0, :nx] = x.numel() + np.arange(nx)
        z = ca.reshape(source.nz[index.ravel().tolist()], index.size // len(index), len(index))
        return z, ca.repmat(p[nx:], 1, self.program.knots)

    def packed(self, values: ca.MX) -> ca.MX:
        """w of the ``values`` (nz, N) of all stages."""
        return ca.vec(values).nz[np.flatnonzero(self.program.present.ravel()).tolist()]

    def jacobian(self, stage: _Stage, z: ca.MX, s: ca.MX) -> _Entries:
        """∂g/∂w."""
        m, nx, rows_of = self.program.intervals, self.program.nx, self.program.rows
        before, after = self.variables[:-1], self.variables[1:]
        blocks = [
            _block(rows_of.defects, before, stage.jacobian_pattern, stage.jacobian.map(m)(z[:, :-1], s[:, :-1])),
            _Entries(  # of the next state and step
                rows_of.defects.ravel(), after[:, : nx + 1].ravel(), ca.MX.ones(m * (nx + 1))
            ),
        ]
        counts = self.program.counts
        if counts.clearances:
            values = stage.clearance_jacobian.map(m)(z[:, 1:], s[:, 1:])
            blocks.append(_block(rows_of.clearances, after, stage.clearance_pattern, values))
        if sum(counts.mixed):
            values = stage.mixed_jacobian.map(m)(z[:, :-1], s[:, :-1])
            blocks.append(_block(rows_of.mixed, before, stage.mixed_pattern, values))
        if sum(counts.final):
            values = stage.final_jacobian(z[:, -1], s[:, -1])
            blocks.append(_block(rows_of.final[None], self.variables[-1:], stage.final_pattern, values))
        return _joined(blocks)

    def lagrangian(self, stage: _Stage, z: ca.MX, s: ca.MX, of_f: ca.MX, of_g: ca.MX) -> tuple[ca.MX, _Entries]:
        """The gradient (nw,) and the second derivatives of λ_f f + λᵀg."""
        m, nx, rows_of = self.program.intervals, self.program.nx, self.program.rows
        defects, mixed, chosen = (_of(of_g, rows) for rows in (rows_of.defects, rows_of.mixed, rows_of.clearances))
        clearances = ca.horzcat(ca.MX.zeros(chosen.size1(), 1), chosen)
        values, gradient = stage.hessian.map(m)(
            z[:, :-1], s[:, :-1], ca.repmat(of_f, 1, m), defects, clearances[:, :-1], mixed
        )
        final = _of(of_g, rows_of.final[None])
        end, end_gradient = stage.end_hessian(z[:, -1], s[:, -1], of_f, clearances[:, -1], final)
        rows, columns = stage.hessian_pattern
        end_rows, end_columns = stage.end_pattern
        hessian = _joined(
            [
                _Entries(self.variables[:-1][:, rows].ravel(), self.variables[:-1][:, columns].ravel(), ca.vec(values)),
                _Entries(self.variables[-1][end_rows], self.variables[-1][end_columns], end),
            ]
        )
        of_ends = ca.horzcat(ca.MX.zeros(nx + 1, 1), defects)
        of_next = ca.vertcat(of_ends, ca.MX.zeros(self.program.nu, m + 1))
        return self.packed(ca.horzcat(gradient, end_gradient) + of_next), hessian
