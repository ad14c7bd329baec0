"""Cuts and parts of graphs whose best cuts are known."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from moe_policy.learning import graph_cuts
from moe_policy.learning.graph_cuts import best_cut, parts_of, symmetric, width_of
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.system import Box, Coordinate


def graph_of(pairs, count, weights=None):
    pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return symmetric(pairs, np.ones(len(pairs)) if weights is None else np.array(weights, float), count)


def grid(rows, columns):
    """Pairs of neighbours in a grid of rows · columns nodes."""
    number = np.arange(rows * columns).reshape(rows, columns)
    right = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    down = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    return np.concatenate([right, down])


def joined_grids(*shapes, bridges=1):
    """Grids of these shapes, each joined to the next by so many edges."""
    pairs, begin = [], 0
    for rows, columns in shapes:
        if begin:
            pairs.append([[begin - 1 - i, begin + i] for i in range(bridges)])
        pairs.append(grid(rows, columns) + begin)
        begin += rows * columns
    return np.concatenate(pairs), begin


@pytest.mark.parametrize("count", [2, 3, 8, 40])
def test_the_best_cut_of_a_path_is_in_its_middle(count):
    conductance, side = best_cut(graph_of([[i, i + 1] for i in range(count - 1)], count))
    half = count // 2
    # Of the count − 1 edges one is cut; the smaller side has half of the nodes, and 2 half − 1 ends of edges.
    assert conductance == pytest.approx(1 / (2 * half - 1))
    assert min(side.sum(), (~side).sum()) == half


@pytest.mark.parametrize(("rows", "columns"), [(4, 10), (12, 30), (20, 61)])
def test_the_best_cut_of_a_grid_is_across_its_longer_side(rows, columns):
    """With few nodes and with many, whose eigenvector is found by other means."""
    graph = graph_of(grid(rows, columns), rows * columns)
    conductance, side = best_cut(graph)
    volume = graph.sum()
    halves = np.abs(graph[side].sum() / volume - 0.5)
    assert halves <= 1 / columns
    assert conductance == pytest.approx(rows / min(graph[side].sum(), graph[~side].sum()))


def test_an_eigenvector_that_does_not_converge_still_gives_the_thin_cut(monkeypatch):
    monkeypatch.setattr(graph_cuts, "_SMALL", 10)

    def lost(*arguments, **options):
        raise graph_cuts.ArpackNoConvergence("no convergence", np.empty(0), np.empty((0, 0)))

    monkeypatch.setattr(graph_cuts, "eigsh", lost)
    pairs, count = joined_grids((8, 8), (8, 8))
    _, side = best_cut(graph_of(pairs, count))
    assert set(side[:64]) != set(side[64:])
    assert len(set(side[:64])) == len(set(side[64:])) == 1


@pytest.mark.parametrize("count", [100, 1000])
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1.0, 0.3), (2.0, 1.0, 1.0)])
def test_a_straight_cut_through_a_box_has_the_width_one_whatever_the_number_of_points(count, lengths):
    points = np.random.default_rng(0).uniform(0, lengths, (count, len(lengths)))
    box = Box(tuple(Coordinate(f"x{i}", 0.0, 1.0) for i in range(len(lengths))))
    pairs = neighbour_pairs(box, points, 8)
    graph, side = graph_of(pairs, count), points[:, 0] < lengths[0] / 2
    conductance = graph[side][:, ~side].sum() / min(graph[side].sum(), graph[~side].sum())
    assert width_of(graph, points, side, conductance) == pytest.approx(1, abs=0.25)
    assert width_of(graph, points * 10, side, conductance) == pytest.approx(width_of(graph, points, side, conductance))


def places(*shapes):
    """Points of the nodes of :func:`joined_grids`, one grid beside the other."""
    found, begin = [], 0
    for rows, columns in shapes:
        row, column = np.divmod(np.arange(rows * columns), columns)
        found.append(np.stack([row, column + begin], axis=1).astype(float))
        begin += columns
    return np.concatenate(found)


def test_parts_are_components_split_along_thin_cuts_the_largest_first():
    pairs, count = joined_grids((6, 6), (6, 9), (6, 6))
    apart = np.concatenate([pairs, grid(5, 5) + count])
    graph, points = graph_of(apart, count + 25), places((6, 6), (6, 9), (6, 6), (5, 5))
    parts = parts_of(graph, graph, points, 0.4, 5)
    assert np.bincount(parts.values).tolist() == [54, 36, 36, 25]
    assert (parts.values[36:90] == 0).all()
    assert parts.components == (126, 25)
    assert len(parts.accepted) == 2
    assert len(parts.rejected) == 4
    assert max(cut.width for cut in parts.accepted) < 0.4 < min(cut.width for cut in parts.rejected)
    whole = parts_of(graph, graph, points, 0.0, 5)
    np.testing.assert_array_equal(whole.values, connected_components(graph)[1])


def test_further_cuts_are_the_thinnest_ones_as_far_as_both_sides_are_large_enough():
    pairs, count = joined_grids((6, 6), (6, 9), (6, 6))
    graph, points = graph_of(pairs, count), places((6, 6), (6, 9), (6, 6))
    assert [np.bincount(parts_of(graph, graph, points, 0.0, 5, least).values).tolist() for least in (1, 3)] == [
        [126],
        [54, 36, 36],
    ]
    assert parts_of(graph, graph, points, 0.0, 5, 4).values.max() == 3
    assert parts_of(graph, graph, points, 0.0, 30, 9).values.max() == 2


def test_small_pieces_go_to_the_part_that_supports_them_best_also_through_each_other():
    pairs = np.concatenate([grid(4, 5), grid(4, 4) + 20])
    graph, points = graph_of(pairs, 39), np.zeros((39, 1))
    links = [[36, 0], [36, 1], [36, 20], [37, 36]]  # 37 reaches the large parts through 36 alone, and 38 not at all
    support = graph_of(np.concatenate([pairs, links]), 39)
    parts = parts_of(graph, support, points, 0.0, 3)
    assert parts.values[36:].tolist() == [0, 0, 0]
    assert parts.moved.sum() == 3
    weights = np.ones(len(pairs) + 4)
    weights[-2] = 5.0
    stronger = graph_of(np.concatenate([pairs, links]), 39, weights)
    assert parts_of(graph, stronger, points, 0.0, 3).values[36:].tolist() == [1, 1, 0]


def test_a_graph_without_edges_is_one_part():
    graph = graph_of([], 4)
    assert parts_of(graph, graph, np.zeros((4, 1)), 0.1, 2).values.tolist() == [0, 0, 0, 0]
