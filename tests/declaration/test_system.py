import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.system import Box, Coordinate, System, rk4_step, wrap

FINITE = st.floats(-1e3, 1e3)


@given(FINITE, st.floats(0.1, 10.0))
def test_wrap_moves_by_whole_periods_into_the_half_open_interval(difference, period):
    wrapped = wrap(difference, period)
    assert -period / 2 - 1e-9 <= wrapped <= period / 2 + 1e-9
    turns = (difference - wrapped) / period
    assert abs(turns - round(turns)) < 1e-6


@given(FINITE, FINITE, st.integers(-3, 3))
def test_difference_does_not_see_whole_turns(theta, omega, turns):
    system = PENDULUM.system
    a = np.array([theta, omega])
    b = np.array([theta + 0.3 + 2 * np.pi * turns, omega - 1.0])
    np.testing.assert_allclose(system.difference(a, b), [-0.3, 1.0], atol=1e-6)


def test_difference_is_the_same_for_arrays_and_expressions():
    system = PENDULUM.system
    x = ca.SX.sym("x", 2)
    symbolic = ca.Function("d", [x], [system.difference(x, ca.DM([np.pi, 0.0]))])
    for theta in np.linspace(-12, 18, 31):
        point = np.array([theta, 0.7])
        np.testing.assert_allclose(
            np.array(symbolic(point)).ravel(), system.difference(point, np.array([np.pi, 0.0])), atol=1e-12
        )


def test_rk4_has_order_four_on_a_linear_equation():
    errors = [abs(rk4_step(lambda y: -y, 1.0, 1.0, n) - np.exp(-1.0)) for n in (2, 4, 8)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(orders - 4) < 0.35)


def test_other_constants_are_another_value_of_the_same_declaration():
    heavy = PENDULUM.system.with_constants(mass=2.0)
    x, u = ca.DM([1.0, 0.0]), ca.DM([1.0])
    # ω̇ = (u − m g sin θ)/m with l = 1
    assert float(heavy.derivative(x, u, {})[1]) == pytest.approx(0.5 - np.sin(1.0))
    assert float(PENDULUM.system.derivative(x, u, {})[1]) == pytest.approx(1.0 - np.sin(1.0))
    with pytest.raises(ValueError, match="no constant"):
        PENDULUM.system.with_constants(weight=2.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "2x", "lower": 0, "upper": 1}, "identifier"),
        ({"name": "x", "lower": 1, "upper": 1}, "lower < upper"),
        ({"name": "x", "lower": 0, "upper": float("inf")}, "finite"),
        ({"name": "x", "lower": 0, "upper": 1, "scale": 0.0}, "scale"),
        ({"name": "x", "lower": 0, "upper": 1, "period": -1.0}, "period"),
    ],
)
def test_bad_coordinates_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Coordinate(**arguments)


def test_repeated_names_and_wrong_dynamics_are_refused():
    a = Coordinate("a", 0, 1)
    with pytest.raises(ValueError, match="unique"):
        Box((a, a))
    with pytest.raises(ValueError, match="returned 2 components, expected 1"):
        System("s", Box((a,)), Box((a,)), {}, lambda x, u, c: [x[0], x[0]])


def test_a_box_contains_its_bounds_and_no_nan():
    box = PENDULUM.parameters
    assert box.contains(np.stack([box.lower, box.upper])).all()
    assert not box.contains(np.array([np.nan, 0.0]))
    assert not box.contains(box.upper + 1e-3)
    assert box.contains(box.upper + 1e-3, tolerance=1e-2)


def test_draws_from_a_box_are_uniform_and_longer_ones_begin_with_shorter_ones():
    box = Box((Coordinate("a", -1.0, 3.0), Coordinate("b", 2.0, 2.5)))
    np.testing.assert_array_equal([box.width, box.centre], [[4.0, 0.5], [1.0, 2.25]])
    draws = box.draw(np.random.default_rng(3), 4_000)
    assert box.contains(draws).all()
    np.testing.assert_allclose((draws.mean(axis=0) - box.centre) / box.width, 0, atol=5 / np.sqrt(12 * len(draws)))
    np.testing.assert_allclose(draws.std(axis=0) / box.width, 1 / np.sqrt(12), rtol=0.05)
    np.testing.assert_array_equal(box.draw(np.random.default_rng(3), 7), draws[:7])
