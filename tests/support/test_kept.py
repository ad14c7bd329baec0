"""Results that are kept with an immutable value."""

import copy
import gc
import pickle
import weakref

import pytest

from ocp_envs.support.kept import KEPT, kept
from tests.threads import in_threads


class Value:
    def __init__(self, number):
        self.number = number
        self.made = 0

    def __reduce__(self):
        return Value, (self.number,)

    @kept
    def times(self, factor=1):
        """The product."""
        self.made += 1
        return [self.number * factor]


@kept
def plus(value, other):
    value.made += 1
    return [value.number + other]


def test_a_result_is_made_once_for_each_value_and_argument():
    value, other = Value(3), Value(3)
    assert value.times(2) is value.times(2)
    assert value.times(2) is not other.times(2)
    assert (value.times(2), value.times(4), plus(value, 2)) == ([6], [12], [5])
    assert (value.made, other.made) == (3, 1)


def test_few_results_are_kept():
    value = Value(3)
    first = value.times(0)
    for factor in range(1, KEPT + 1):
        value.times(factor)
    assert value.times(0) is not first


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_have_no_results(duplicate):
    value = Value(3)
    value.times(2)
    assert duplicate(value).made == 0
    assert duplicate(value).times(2) == [6]


def test_results_end_with_their_value():
    value = Value(3)
    value.times(2)
    gone = weakref.ref(value)
    del value
    gc.collect()
    assert gone() is None


def test_threads_get_the_same_result():
    value = Value(3)
    assert in_threads(lambda number: value.times(2)) == [[6]] * 4


def test_a_kept_function_keeps_its_name_and_text():
    assert (Value.times.__name__, Value.times.__doc__) == ("times", "The product.")
