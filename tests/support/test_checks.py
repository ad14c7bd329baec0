import numpy as np
import pytest

from ocp_envs.support.checks import check_kind, check_number, check_whole


def test_whole_numbers_are_those_of_python_and_numpy():
    for value in (1, np.int32(4), np.uint8(5)):
        check_whole("k", value, 1, 5)


@pytest.mark.parametrize(("value", "error"), [(0, ValueError), (6, ValueError), (1.0, TypeError), (True, TypeError)])
def test_other_whole_numbers_are_refused_by_name(value, error):
    with pytest.raises(error, match=f"^k: expected a whole number in 1 … 5, got {value}$"):
        check_whole("k", value, 1, 5)


def test_numbers_are_finite():
    for value in (0.1, 3, np.float32(2)):
        check_number("x", value, lower=0.0)
    for value in (0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"^x: expected a positive number, got"):
            check_number("x", value, "a positive number", 0.0)
    for value in ("1", None, False, 1j):
        with pytest.raises(TypeError, match=r"^x: expected a finite number, got"):
            check_number("x", value)


def test_kinds_are_named_with_a_cure():
    check_kind("x", 1, (int, str))
    with pytest.raises(TypeError, match=r"^x: expected int or str, got float 1\.5; write 1$"):
        check_kind("x", 1.5, (int, str), "write 1")
