"""Solution families that are found, not declared: parts of the graph of what continuation joins.

The nodes of the graph are instances, its edges the pairs of neighbours whose optima lead to each other in both
directions (:mod:`ocp_envs.data.continuation`). Its connected components are families, or several families that touch
where the discontinuity ends; these are told apart by thin cuts (:mod:`moe_policy.learning.graph_cuts`). *Measured*: the
cut between the vehicle's families that drive forwards and backwards has a width of 0.012; all other best cuts, of
single families of the pendulum, the vehicle and the quadcopter, have 0.5 to 1. The threshold is between.
"""

from __future__ import annotations

import math

import numpy as np

from moe_policy.learning.graph_cuts import Parts, parts_of, symmetric
from ocp_envs.data.continuation import Continuation
from ocp_envs.support.arrays import Array
from ocp_envs.system import Box

#: Neighbours of each instance, the width of a cut below which a part is split, and the smallest part, as a fraction of
#: all instances: the instances of smaller pieces go to the part that they continue into best.
NEIGHBOURS, WIDTH, SMALLEST = 8, 0.1, 0.01
#: Support of a pair that does not agree, relative to a solve that does.
_ADJACENT = 1e-3


def families_of(
    continuation: Continuation,
    box: Box,
    parameters: Array,
    *,
    least: int = 1,
    width: float = WIDTH,
    smallest: float = SMALLEST,
) -> Parts:
    """The solution families of instances with ``parameters`` (M, np), by what ``continuation`` says of their pairs.

    A part is split along a cut that is thinner than ``width``, every coordinate of p divided by the width of its
    ``box``. Where fewer than ``least`` families are found, the thinnest of the other cuts split them further. Parts
    have at least the fraction ``smallest`` of all instances.
    """
    pairs, joined, count = continuation.pairs, continuation.joined, len(parameters)
    graph = symmetric(pairs[joined], np.ones(int(joined.sum())), count)
    support = symmetric(pairs, continuation.agrees.sum(axis=1) + _ADJACENT, count)
    return parts_of(graph, support, parameters / box.width, width, math.ceil(smallest * count), least)


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
        "merged": parts.merged,
    }
