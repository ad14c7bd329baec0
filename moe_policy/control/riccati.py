"""The Riccati recursion along plans with NumPy, for all plans at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ocp_envs.support.arrays import Array, Ints

#: The recursion linearises at most this many different numbers of plans, and about so many control steps of all plans
#: at once, or those of one step.
_SIZES, _ROWS = 8, 256


class References(NamedTuple):
    """What B plans are tracked with, and their weights.

    The references ``states`` (B, T+1, nx), the feed-forward ``controls`` (B, T, nu), ``contexts`` (B, nc), the numbers
    of control ``steps`` (B,), at most T, and the diagonals of Q, ``q`` (nx,), and R, ``r`` (B, T, nu); the recursion
    begins with ``terminal`` (B, nx, nx).
    """

    states: Array
    controls: Array
    contexts: Array
    steps: Ints
    q: Array
    r: Array
    terminal: Array


#: (x (B, nx), u (B, nu), s (B, nc)) → A (B, nx, nx), B (B, nx, nu).
Linearise = Callable[[Array, Array, Array], tuple[Array, Array]]


def run(linearise: Linearise, plans: References, gains: Array, norms: Array) -> None:
    """The recursion of ``plans`` with the derivatives of ``linearise``, into ``gains`` and ``norms``."""
    _, longest, nu = plans.controls.shape
    # The longest plans first: at each control step the plans under way are a prefix.
    order = np.argsort(-plans.steps, kind="stable")
    under_way = np.searchsorted(-plans.steps[order], -np.arange(longest), side="left")
    q, p, unit_matrix = np.diag(plans.q), np.array(plans.terminal)[order], np.eye(nu)
    for k, a, b in _backwards(linearise, plans, order, under_way):
        n, rows = len(a), order[: len(a)]
        bp = b.swapaxes(1, 2) @ p[:n]
        norm = plans.r[rows, k, :, None] * unit_matrix + bp @ b
        gain = np.linalg.solve(norm, bp @ a)
        gains[rows, k], norms[rows, k] = gain, norm
        following = q + a.swapaxes(1, 2) @ p[:n] @ (a - b @ gain)
        p[:n] = (following + following.swapaxes(1, 2)) / 2


def _backwards(
    linearise: Linearise, plans: References, order: Ints, under_way: Ints
) -> Iterator[tuple[int, Array, Array]]:
    """Each control step from the last to the first, with A and B of the plans under way, the first in ``order``."""
    size, end = len(order), len(under_way)
    unit = max(1, -(-size // _SIZES))
    while end:
        # Several control steps in one call, which for a few plans takes most of the time of a call for one.
        few = np.arange(end, 0, -1) * under_way[:end] <= _ROWS
        begin = int(np.argmax(few)) if few.any() else end - 1
        # Rounded up to a few sizes, because setting up a mapped function takes time for each new batch size.
        rows = order[: min(size, -(-int(under_way[begin]) // unit) * unit)]
        # Rows of one control step after those of the other, so that each step's are contiguous.
        x, u = (
            values[rows, begin:end].swapaxes(0, 1).reshape(-1, values.shape[2])
            for values in (plans.states, plans.controls)
        )
        a, b = linearise(x, u, np.tile(plans.contexts[rows], (end - begin, 1)))
        a, b = (each.reshape(end - begin, len(rows), *each.shape[1:]) for each in (a, b))
        for k in range(end - 1, begin - 1, -1):
            yield k, a[k - begin, : under_way[k]], b[k - begin, : under_way[k]]
        end = begin
