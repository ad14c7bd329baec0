"""Projection of controls onto their bounds.

The cost of one control step and of the steps that follow, if these are not constrained, is (u − u*)ᵀ H (u − u*) plus a
constant, with H = R + BᵀPB and the unconstrained control u* = ū − K δx. The best admissible control is therefore the
projection of u* onto the box in the norm weighted by H: where one rotor is at its bound, the others still generate the
torque. For a single control, or where H is diagonal, the projection is clipping.
"""

from __future__ import annotations

import numpy as np

from ocp_envs.support.arrays import Array
from ocp_envs.system import Box

#: Maximum number of sweeps, and the change of a control, relative to its range, below which they end.
_SWEEPS, _SETTLED = 100, 1e-9


def project(wanted: Array, norm: Array, box: Box) -> Array:
    """The points (B, nu) of ``box`` nearest to the controls ``wanted`` (B, nu), each in the ``norm`` of its row.

    ``norm`` is H (B, nu, nu), symmetric and positive definite. Coordinate descent: each control in turn takes the best
    value given the others, which converges for a box and a positive definite norm (Tseng, *Convergence of a block
    coordinate descent method*, 2001).
    """
    nearest = np.clip(wanted, box.lower, box.upper)
    rows = np.flatnonzero((nearest != wanted).any(axis=1))
    if len(box) == 1 or not len(rows):
        return nearest
    u, h, target = nearest[rows], norm[rows], wanted[rows]
    for _ in range(_SWEEPS):
        before = u.copy()
        for i in range(len(box)):
            slope = (h[:, i] * (u - target)).sum(axis=1)
            u[:, i] = np.clip(u[:, i] - slope / h[:, i, i], box.lower[i], box.upper[i])
        if (np.abs(u - before) <= _SETTLED * box.width).all():
            break
    nearest[rows] = u
    return nearest
