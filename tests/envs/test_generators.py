"""Random generators of rows."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.utils import seeding

from ocp_envs.envs.generators import Generators


def test_an_integer_seeds_row_i_as_an_environment_with_that_seed_plus_i():
    generators = Generators(3, 2)
    generators.seed(5, np.arange(3))
    expected = [seeding.np_random(seed)[0].standard_normal(2) for seed in (5, 6, 7)]
    np.testing.assert_array_equal(generators.normal(np.arange(3)), expected)


def test_only_the_rows_named_are_seeded_again():
    generators = Generators(3, 1)
    generators.seed([1, 1, 1], np.arange(3))
    before = generators.normal(np.arange(3))
    generators.seed([1, 1, None], np.array([1, 2]))
    after = generators.normal(np.arange(3))
    np.testing.assert_array_equal(after[1], before[1])
    assert after[0] != before[0]
    np.testing.assert_array_equal(after[2], after[0])  # not seeded again: it continues like the first


def test_rows_without_a_seed_differ():
    generators = Generators(4, 3)
    assert len(np.unique(generators.normal(np.arange(4)))) == 12
    assert generators.normal(np.arange(0)).shape == (0, 3)
    with pytest.raises(ValueError, match="4 seeds"):
        generators.seed([1, 2], np.arange(4))


def test_numbers_drawn_ahead_are_those_of_single_draws_whatever_comes_between():
    many, rng = Generators(3, 2), np.random.default_rng(1)
    every = np.arange(3)
    many.seed(7, every)
    alone = [seeding.np_random(7 + row)[0] for row in range(3)]
    for _ in range(300):
        rows = every[rng.random(3) < 0.7]
        expected = [alone[row].standard_normal(2) for row in rows]
        np.testing.assert_array_equal(many.normal(rows), np.reshape(expected, (-1, 2)))
        if rng.random() < 0.1:
            assert many[1].random() == alone[1].random()
