from __future__ import annotations

import numpy as np
import pytest
import torch

from moe_policy.learning.examples import Examples, Split


def test_a_split_is_decided_by_its_seed_and_has_both_parts():
    split = Split.draw(100, 0.2, seed=3)
    assert (len(split.training), len(split.test)) == (80, 20)
    np.testing.assert_array_equal(np.sort(np.concatenate([split.training, split.test])), np.arange(100))
    np.testing.assert_array_equal(Split.draw(100, 0.2, seed=3).test, split.test)
    assert not np.array_equal(Split.draw(100, 0.2, seed=4).test, split.test)
    assert [len(part) for share in (0.001, 0.999) for part in vars(Split.draw(2, share, 0)).values()] == [1, 1, 1, 1]
    with pytest.raises(ValueError, match="at least two samples, got 1"):
        Split.draw(1, 0.2, 0)


def test_clusters_without_test_rows_are_tested_on_their_training_rows():
    split = Split(np.array([0, 2, 3]), np.array([1, 4]))
    alone = split.within(np.array([True, False, True, False, False]))
    np.testing.assert_array_equal(alone.training, [0, 2])
    np.testing.assert_array_equal(alone.test, alone.training)


def examples(split: Split) -> Examples:
    x = np.arange(10, dtype=np.float32)[:, None]
    return Examples(x, 10 * x, split)


@pytest.mark.parametrize("split", [Split(np.array([7, 2]), np.array([5])), Split(np.array([4, 1]), np.array([4, 1]))])
def test_compact_examples_have_the_rows_of_the_split_alone(split):
    whole = examples(split)
    compact = whole.compact()
    assert len(compact.x) == len({*split.training, *split.test})
    for part in ("training", "test"):
        rows, wanted = getattr(compact.split, part), getattr(split, part)
        np.testing.assert_array_equal(compact.x[rows], whole.x[wanted])
        np.testing.assert_array_equal(compact.y[rows], whole.y[wanted])


def test_examples_that_all_take_part_are_not_copied():
    whole = examples(Split(np.arange(7), np.arange(7, 10)))
    assert whole.compact() is whole
    assert whole.tensors[0].data_ptr() == whole.x.ctypes.data


def test_further_examples_train_or_test_as_their_row_does():
    whole = examples(Split(np.array([0, 1, 3, 4, 6, 7, 8, 9]), np.array([2, 5])))
    more = whole.with_further(np.array([5, 1, 2]), np.array([[-5], [-1], [-2]], dtype=np.float32))
    np.testing.assert_array_equal(more.x[:, 0], [*range(10), 5, 1, 2])
    np.testing.assert_array_equal(more.y[:, 0], [*range(0, 100, 10), -5, -1, -2])
    assert more.split.training.tolist() == [*whole.split.training, 11]
    assert more.split.test.tolist() == [2, 5, 10, 12]


def test_the_test_loss_is_a_mean_over_rows_whatever_their_number():
    count = 20_000  # more than are evaluated at once
    x = np.random.default_rng(0).random((count, 1)).astype(np.float32)
    split = Split(np.arange(10), np.arange(10, count))
    loss = Examples(x, x, split).test_loss(lambda inputs, outputs, epoch: inputs.mean() + epoch, epoch=2)
    assert loss == pytest.approx(x[10:].mean() + 2, rel=1e-5)


def test_classes_are_told_from_trajectories():
    split = Split(np.array([0]), np.array([1]))
    x = np.zeros((2, 1), np.float32)
    assert Examples(x, np.array([0, 1]), split).classified
    assert not Examples(x, x, split).classified
    assert Examples(x, np.array([0, 1]), split).tensors[1].dtype == torch.int64
