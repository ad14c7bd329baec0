"""Whole numbers from many generators are those of one after another, and so is what the generators draw afterwards."""

import numpy as np
import pytest

from ocp_envs.support import draws
from ocp_envs.support.compiler import find_compiler

BITS = [np.random.PCG64, np.random.PCG64DXSM, np.random.MT19937, np.random.Philox, np.random.SFC64]


def generators(count=300):
    """Generators of every kind; every third has half a word left from an earlier draw."""
    made = [np.random.Generator(BITS[i % len(BITS)](i)) for i in range(count)]
    for generator in made[::3]:
        generator.integers(10, dtype=np.uint32)
    return made


@pytest.fixture(params=["compiled", "one after another"])
def way(request, monkeypatch):
    if request.param != "compiled":
        monkeypatch.setattr(draws, "_MANY", np.inf)
    elif find_compiler() is None:
        pytest.skip("needs a C compiler")


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("below", [1, 2, 7, 1000, 20_001, 2**31 + 5, 2**32 - 1, 2**32, 2**40])
def test_numbers_and_what_follows_are_the_same(below):
    many, each = generators(), generators()
    for _ in range(4):
        np.testing.assert_array_equal(draws.whole_numbers(many, below), [g.integers(below) for g in each])
    np.testing.assert_array_equal([g.standard_normal() for g in many], [g.standard_normal() for g in each])


@pytest.mark.usefixtures("way")
def test_no_generators_draw_nothing():
    assert draws.whole_numbers([], 5).shape == (0,)
