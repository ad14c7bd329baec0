"""Solution families that are found, not declared: parts of the graph of what continuation joins.

The nodes of the graph are instances, its edges the pairs of neighbours whose optima lead to each other in both
directions (:mod:`ocp_envs.data.continuation`). Its connected components are families, or several families that touch
where the discontinuity ends; these are told apart by thin cuts (:mod:`moe_policy.learning.graph_cuts`). There the
optimum changes fast, and the cut belongs where it changes fastest. The graph that is cut has more edges, between each
instance and its nearest neighbours in the same component, apart from pairs that continuation did not join: next to a
discontinuity families may be as thin as the spacing of instances. With the steepness s = ‖Δz‖ / ‖Δp‖ of an edge (z
standardised, p in box widths) relative to the median of joined pairs, its weight is 1 / (1 + s³).

Components of a few instances to which no neighbour leads are not families. Each goes to that of the nearest trajectory
among its nearest neighbours in p: families may be neighbours in p, but their trajectories are not.

*Measured*: the cut between the vehicle's families that drive forwards and backwards has a width of 0.001, the one
between the pendulum's swing-ups to the same final angle from the left and from the right 0.03; the best cuts of all
other families have 0.4 or more. The threshold is between.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from moe_policy.learning.graph_cuts import Parts, parts_of, symmetric
from moe_policy.planners.scaling import Standardizer, blocks
from ocp_envs.data.continuation import Continuation
from ocp_envs.data.neighbours import Neighbours, neighbour_pairs
from ocp_envs.data.samples import Samples
from ocp_envs.support.arrays import Array, Bools, Ints

#: Neighbours of each instance, the width of a cut below which a part is split, and the smallest part, as a fraction of
#: all instances: the instances of smaller pieces go to the part that they continue into best.
NEIGHBOURS, WIDTH, SMALLEST = 8, 0.1, 0.005
#: Nearest neighbours of each instance in the graph that is cut, and the least weight of an edge.
_NEAR, _LEAST = 16, 1e-9
#: Neighbours of an instance in a small component among which the nearest trajectory is looked for, and its support for
#: the family of that trajectory, relative to a solve that agrees.
_AMONG, _NEAREST = 64, 10.0


def families_of(
    samples: Samples,
    continuation: Continuation,
    *,
    least: int = 1,
    width: float = WIDTH,
    smallest: float = SMALLEST,
) -> Parts:
    """The solution families of M ``samples``, by what ``continuation`` says of their pairs.

    A part is split along a cut that is thinner than ``width``, every coordinate of p divided by the width of its box.
    Where fewer than ``least`` families are found, the thinnest of the other cuts split them further. Parts have at
    least the fraction ``smallest`` of all instances.
    """
    pairs, joined, count = continuation.pairs, continuation.joined, len(samples)
    enough = math.ceil(smallest * count)
    component = connected_components(symmetric(pairs[joined], np.ones(int(joined.sum())), count), directed=False)[1]
    nearest = _nearest(samples, np.bincount(component)[component] < enough)
    support = symmetric(pairs, continuation.agrees.sum(axis=1).astype(float), count)
    support = support + symmetric(nearest, np.full(len(nearest), _NEAREST), count)
    points = samples.parameters / samples.problem.parameters.width
    return parts_of(_graph(samples, pairs, joined, component), support, points, width, enough, least)


def _nearest(samples: Samples, alone: Bools) -> Ints:
    """Each sample that is ``alone`` (M,), and its neighbour with the nearest trajectory that is not, (A, 2)."""
    rows = np.flatnonzero(alone)
    if not len(rows) or alone.all():
        return np.empty((0, 2), dtype=np.int64)
    others = np.flatnonzero(~alone)
    known = Neighbours(samples.problem.parameters, samples.parameters[others])
    near = others[known.nearest(samples.parameters[rows], min(_AMONG, len(others)))[1]]
    pairs = np.stack([np.repeat(rows, near.shape[1]), near.ravel()], axis=1)
    change = _changes(samples, pairs).reshape(near.shape)
    return np.stack([rows, near[np.arange(len(rows)), change.argmin(axis=1)]], axis=1)


def _graph(samples: Samples, pairs: Ints, joined: Bools, component: Ints) -> csr_matrix:
    """The graph that is cut, with the components (M,) of that of the ``pairs`` (E, 2) that are ``joined`` (E,)."""
    count = len(samples)
    near = neighbour_pairs(samples.problem.parameters, samples.parameters, _NEAR)
    near = near[component[near[:, 0]] == component[near[:, 1]]]
    number = np.array([count, 1])  # of a pair (i, j): i · count + j
    near = near[~np.isin(near @ number, pairs[~joined] @ number)]
    edges = np.stack(np.divmod(np.unique(np.concatenate([pairs[joined] @ number, near @ number])), count), axis=1)
    if not len(edges):
        return symmetric(edges, np.empty(0), count)
    middle, steep = np.median(steepness(samples, pairs[joined])), steepness(samples, edges)
    relative = steep / middle if middle > 0 else np.zeros(len(steep))
    return symmetric(edges, np.maximum(1 / (1 + relative**3), _LEAST), count)


def steepness(samples: Samples, pairs: Ints) -> Array:
    """How fast the optimum changes between the ``pairs`` (E, 2) of ``samples``, ‖Δz‖ / ‖Δp‖, (E,).

    Trajectories are standardised, and parameters divided by the widths of their box; +inf for copies of an instance
    with other trajectories.
    """

    found, width = _changes(samples, pairs), samples.problem.parameters.width
    for rows in blocks(len(pairs)):
        i, j = pairs[rows].T
        step = np.linalg.norm((samples.parameters[i] - samples.parameters[j]) / width, axis=1)
        with np.errstate(divide="ignore"):
            found[rows] = np.divide(found[rows], step, out=np.zeros(len(step)), where=found[rows] > 0)
    return found


def _changes(samples: Samples, pairs: Ints) -> Array:
    """The distances ‖Δz‖ of the standardised trajectories of ``pairs`` (E, 2) of ``samples``, (E,)."""

    def flat(rows: Ints | slice) -> Array:
        return samples.trajectory[rows].flat()

    scaler = Standardizer.fit_blocks(lambda: map(flat, blocks(len(samples))))
    found = np.zeros(len(pairs))
    for rows in blocks(len(pairs)):
        i, j = pairs[rows].T
        found[rows] = np.linalg.norm(scaler.scale(flat(i)) - scaler.scale(flat(j)), axis=1)
    return found


def record(continuation: Continuation, parts: Parts) -> dict[str, object]:
    """How ``parts`` were found from ``continuation``, as JSON."""
    return {
        "neighbours": NEIGHBOURS,
        "width": WIDTH,
        "smallest": SMALLEST,
        "pairs": len(continuation.pairs),
        "pairs_not_joined": int((~continuation.joined).sum()),
        "components": len(parts.components),
        "cuts": [cut.width for cut in parts.accepted],
        "thinnest_rejected_cut": min((cut.width for cut in parts.rejected), default=None),
        "merged": int(parts.moved.sum()),
    }
