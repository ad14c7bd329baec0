"""Batches keep their rows together, whatever is selected, joined or replaced."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ocp_envs.support.arrays import Array
from ocp_envs.support.rows import Batch


@dataclass(frozen=True, eq=False)
class Inner(Batch):
    table: Array


@dataclass(frozen=True, eq=False)
class Outer(Batch):
    name: str
    number: Array
    inner: Inner
    absent: Array | None = None


def batch(*numbers, name="first"):
    values = np.array(numbers, dtype=np.float64)
    return Outer(name, values, Inner(np.outer(values, [1.0, 10.0])))


def same(one, other):
    assert (one.name, one.absent) == (other.name, other.absent)
    np.testing.assert_array_equal(one.number, other.number)
    np.testing.assert_array_equal(one.inner.table, other.inner.table)


@pytest.mark.parametrize(
    ("rows", "chosen"),
    [
        (1, [2]),
        (np.int64(-1), [3]),
        (slice(1, None), [2, 3]),
        (np.array([True, False, True]), [1, 3]),
        (np.array([2, 0, 2]), [3, 1, 3]),
    ],
)
def test_rows_of_all_fields_are_selected(rows, chosen):
    same(batch(1, 2, 3)[rows], batch(*chosen))
    assert len(batch(1, 2, 3)[rows]) == len(chosen)


def test_parts_are_joined_in_order_and_what_has_no_rows_is_the_first_ones():
    same(Outer.concatenate([batch(1), batch(2, 3, name="second")]), batch(1, 2, 3))


def test_rows_are_replaced_in_a_copy():
    old = batch(1, 2, 3)
    same(old.replaced(np.array([True, False, True]), batch(7, 8)), batch(7, 2, 8))
    same(old, batch(1, 2, 3))


def test_absent_fields_stay_absent_and_present_ones_do_not():
    whole = replace(batch(1, 2), absent=np.array([5.0, 6.0]))
    np.testing.assert_array_equal(whole[1].absent, [6.0])
    assert batch(1, 2)[1].absent is None
