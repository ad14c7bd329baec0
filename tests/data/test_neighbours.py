"""The nearest parameters, against distances computed one by one."""

import numpy as np

from ocp_envs.data.neighbours import Neighbours, neighbour_pairs
from ocp_envs.system import Box, Coordinate

BOX = Box((Coordinate("a", 0.0, 100.0), Coordinate("b", 0.0, 1.0)))


def test_distances_are_counted_in_widths_of_the_box():
    rng = np.random.default_rng(0)
    stored, p = BOX.draw(rng, 30), BOX.draw(rng, 5)
    offsets = (stored - p[:, None]) / [100.0, 1.0]
    lengths = np.linalg.norm(offsets, axis=2)
    search = Neighbours(BOX, stored)
    distance, rows = search.nearest(p, 4)
    np.testing.assert_array_equal(rows, lengths.argsort(axis=1)[:, :4])
    np.testing.assert_allclose(distance, np.sort(lengths, axis=1)[:, :4])
    np.testing.assert_allclose(search.offsets(p, rows), np.take_along_axis(offsets, rows[..., None], axis=1))


def test_no_more_neighbours_are_found_than_there_are():
    distance, rows = Neighbours(BOX, np.array([[1.0, 0.5], [2.0, 0.5]])).nearest(np.array([[1.9, 0.5]]), 9)
    assert rows.tolist() == [[1, 0]]
    assert distance.shape == (1, 2)


def test_every_pair_of_neighbours_occurs_once():
    p = BOX.draw(np.random.default_rng(0), 40)
    lengths = np.linalg.norm((p - p[:, None]) / [100.0, 1.0], axis=2)
    nearest = lengths.argsort(axis=1)[:, 1:4]
    expected = {(min(i, int(j)), max(i, int(j))) for i in range(40) for j in nearest[i]}
    found = neighbour_pairs(BOX, p, 3)
    assert list(map(tuple, found.tolist())) == sorted(expected)


def test_copies_are_neighbours_of_each_other_and_one_point_has_none():
    assert neighbour_pairs(BOX, np.array([[1.0, 0.5]] * 3), 2).tolist() == [[0, 1], [0, 2], [1, 2]]
    assert neighbour_pairs(BOX, np.array([[1.0, 0.5]]), 2).shape == (0, 2)
