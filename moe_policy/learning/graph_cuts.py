"""Parts of a graph of points: its connected components, each split along its normalised cuts where these are thin.

With the weights w_ij ≥ 0 of a graph, the volume of a set of nodes is vol(S) = Σ_{i∈S} Σ_j w_ij, and the conductance of
a cut into S and its complement

    φ(S) = Σ_{i∈S, j∉S} w_ij / min(vol(S), vol(S̄)).

The smallest φ is approximated by a sweep (Shi & Malik, *Normalized cuts and image segmentation*, 2000; Chung, *Spectral
graph theory*, 1997): the nodes are ordered by the second eigenvector of D^−1/2 W D^−1/2, divided by the square roots of
the degrees, and the best of the cuts between two consecutive nodes is taken. By Cheeger's inequality its conductance is
at most twice the square root of the smallest one.

The conductance of a cut between neighbours in space falls with their number: a straight cut through the middle of a box
of length L has φ = E|Δ| / L, where Δ is the component of an edge along L. The *width* of a cut is its conductance
relative to this: with the unit vector e between the centroids of its sides, and over the edges and nodes of the graph,

    w(S) = φ(S) · √12 std(e·x_i) / E|e·(x_i − x_j)|,

1 for a box, whatever the number of points and of dimensions, and less for a neck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ocp_envs.support.arrays import Array, Bools, Ints

#: Of the eigenvector; the sweep takes what it gets.
_TOLERANCE, _ITERATIONS = 1e-5, 3_000
#: Graphs of up to this many nodes are treated as full matrices.
_SMALL = 200


@dataclass(frozen=True)
class Cut:
    """A cut that was tried: its ``width`` w and ``conductance`` φ, and numbers of nodes, ``smaller`` and ``larger``."""

    width: float
    conductance: float
    smaller: int
    larger: int


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of a graph of M nodes.

    Args:
        values: part of every node, (M,), in 0 … k − 1, the largest first.
        components: number of nodes of the connected components, descending.
        accepted: the cuts along which these were split, in the order in which they were found.
        rejected: the best cut of each part that was left whole.
        moved: which nodes are in pieces that were too small, and went to a neighbouring part, (M,).
    """

    values: Ints
    components: tuple[int, ...]
    accepted: tuple[Cut, ...]
    rejected: tuple[Cut, ...]
    moved: Bools


def symmetric(pairs: Ints, weights: Array, count: int) -> csr_matrix:
    """The graph of ``count`` nodes with the ``weights`` (E,) of the ``pairs`` (E, 2) of nodes."""
    i, j = pairs.T
    both = np.concatenate([weights, weights]), (np.concatenate([i, j]), np.concatenate([j, i]))
    return coo_matrix(both, shape=(count, count)).tocsr()


def best_cut(graph: csr_matrix) -> tuple[float, Bools]:
    """The conductance of the best cut of the sweep of a connected ``graph`` of M ≥ 2 nodes, and a side of it, (M,)."""
    degree = np.asarray(graph.sum(axis=1)).ravel()
    order = np.argsort(_fiedler(graph, degree), kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    edges = graph.tocoo()
    first, last = rank[edges.row], rank[edges.col]
    forward = first < last
    weight = edges.data[forward]
    # An edge is cut by all cuts behind its first node and before its last one.
    opened = np.bincount(first[forward], weight, len(order))
    closed = np.bincount(last[forward], weight, len(order))
    cut, volume = np.cumsum(opened - closed)[:-1], np.cumsum(degree[order])[:-1]
    conductance = np.maximum(cut, 0.0) / np.minimum(volume, degree.sum() - volume)
    best = int(conductance.argmin())
    return float(conductance[best]), rank <= best


def _fiedler(graph: csr_matrix, degree: Array) -> Array:
    """The second eigenvector of the normalised ``graph``, divided by the square roots of the degrees, (M,)."""
    count, root = len(degree), np.sqrt(degree)
    scale = diags_array(1 / root)
    normalised = scale @ graph @ scale
    if count <= _SMALL:
        return np.asarray(np.linalg.eigh(normalised.toarray())[1][:, -2] / root)
    # The first eigenvector, √degree, is known, and taken out: where a cut is thin the second eigenvalue is as large.
    first = root / np.linalg.norm(root)

    def times(vector: Array) -> Array:
        """The matrix with its spectrum moved to 0 … 2, applied to what is orthogonal to the first eigenvector."""
        vector = vector.ravel() - first * (first @ vector.ravel())
        product = normalised @ vector + vector
        return product - first * (first @ product)

    start = np.random.default_rng(0).normal(size=count)
    operator = LinearOperator((count, count), matvec=times, dtype=np.float64)
    try:
        second = eigsh(operator, k=1, which="LA", v0=start, tol=_TOLERANCE, maxiter=_ITERATIONS)[1][:, 0]
    except ArpackNoConvergence:  # a second eigenvalue next to others: any vector of their space gives thin cuts
        second = start
        for _ in range(_ITERATIONS):
            second = times(second)
            second /= np.linalg.norm(second)
    return np.asarray(second / root)


def width_of(graph: csr_matrix, points: Array, side: Bools, conductance: float) -> float:
    """The width w of the cut of a ``graph`` of ``points`` (M, n) into ``side`` (M,) and the rest.

    Its ``conductance`` is known.
    """
    direction = points[side].mean(axis=0) - points[~side].mean(axis=0)
    length = np.linalg.norm(direction)
    along = points @ (direction / length if length > 0 else direction)
    edges = graph.tocoo()
    reach = np.abs(along[edges.row] - along[edges.col]).mean()
    return float(conductance * np.sqrt(12) * along.std() / reach) if reach > 0 else conductance


def parts_of(
    graph: csr_matrix, support: csr_matrix, points: Array, width: float, smallest: int, least: int = 1
) -> Parts:
    """Parts of ``graph``: its connected components, split along cuts that are thinner than ``width``.

    The nodes are ``points`` (M, n). Where fewer than ``least`` parts are found this way, further cuts follow, as far as
    both sides are large enough. Pieces of fewer than ``smallest`` nodes are not parts of their own: each goes to the
    part with which the graph ``support``, on the same nodes, joins it best, or to the largest part where it joins it
    with none. (The largest piece is a part in any case.)
    """
    count, values = connected_components(graph, directed=False)
    components, enough = np.bincount(values), max(smallest, 2)
    accepted: list[Cut] = []
    tried = {part: _try(graph, points, values == part) for part in np.flatnonzero(components >= enough).tolist()}
    whole: list[Cut] = []  # no further cuts
    while tried:
        part = min(tried, key=lambda each: tried[each][0].width)
        cut, side = tried.pop(part)
        if cut.width >= width and (len(tried) + len(whole) + 1 >= least or cut.smaller < enough):
            whole.append(cut)
            continue
        accepted.append(cut)
        values[side] = count
        for each in (part, count):
            if np.count_nonzero(values == each) >= enough:
                tried[each] = _try(graph, points, values == each)
        count += 1
    joined, moved = _merged(values, support, smallest)
    order = tuple(sorted(components.tolist(), reverse=True))
    return Parts(_by_size(joined), order, tuple(accepted), tuple(whole), moved)


def _try(graph: csr_matrix, points: Array, part: Bools) -> tuple[Cut, Ints]:
    """The best cut of a ``part`` (M,) of the ``graph``, and the nodes on one of its sides."""
    nodes = np.flatnonzero(part)
    own = graph[nodes][:, nodes]
    conductance, side = best_cut(own)
    smaller, larger = sorted((int(side.sum()), int((~side).sum())))
    return Cut(width_of(own, points[nodes], side, conductance), conductance, smaller, larger), nodes[side]


def _merged(values: Ints, support: csr_matrix, smallest: int) -> tuple[Ints, Bools]:
    """``values`` (M,) with pieces below ``smallest`` nodes in the large ones, and which nodes these are, (M,)."""
    values = np.array(values, dtype=np.int64)
    sizes = np.bincount(values)
    large = (sizes >= smallest) | (np.arange(len(sizes)) == sizes.argmax())
    moved = ~large[values]
    target = np.where(large, np.arange(len(sizes)), -1)
    member = csr_matrix((np.ones(len(values)), (np.arange(len(values)), values)), shape=(len(values), len(sizes)))
    between = (member.T @ support @ member).tocsr()  # of pieces
    while (left := np.flatnonzero(target < 0)).size:
        known = np.flatnonzero(target >= 0)
        to = csr_matrix((np.ones(len(known)), (known, target[known])), shape=between.shape)
        joins = (between[left] @ to).tocsr()
        reached = np.asarray(joins.max(axis=1).todense()).ravel() > 0
        if not reached.any():
            target[left] = sizes.argmax()
            break
        target[left[reached]] = np.asarray(joins.argmax(axis=1)).ravel()[reached]
    return target[values], moved


def _by_size(values: Ints) -> Ints:
    """``values`` (M,) renamed to 0 … k − 1, the largest part first."""
    present, first, renamed, sizes = np.unique(values, return_index=True, return_inverse=True, return_counts=True)
    rank = np.empty(len(present), dtype=np.int64)
    rank[np.lexsort((first, -sizes))] = np.arange(len(present))
    return rank[renamed]
