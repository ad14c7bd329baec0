"""The nearest parameters, against distances computed one by one."""

import numpy as np

from ocp_envs.data.neighbours import Neighbours
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
