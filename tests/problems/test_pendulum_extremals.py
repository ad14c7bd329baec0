"""The pendulum's shipped optima against its Pontryagin extremals: a certificate of global optimality.

With H = 1 + u² + λ₁ ω + λ₂ (u − sin θ), the minimum principle gives u = clip(−λ₂ / 2, −1, 1), λ̇₁ = λ₂ cos θ and
λ̇₂ = −λ₁. The final time is free, so H = 0, and at the goal (θ, ω) = (π, 0) this leaves λ₂ = ∓2, |u| = 1. All extremals
are therefore two one-parameter families in λ₁(t_f), mirror images of each other about the upright position, and an
initial state lies on finitely many of them within 8 s. The cheapest is the global optimum in continuous time. A plan
with controls held over 24 intervals differs from it by its discretisation alone.
"""

from __future__ import annotations

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference

STEP, STEPS = 0.01, 800
#: λ₁ at the goal, dense around zero: extremals diverge exponentially with it.
MULTIPLIERS = 200 * np.sinh(np.linspace(-8, 8, 4001)) / np.sinh(8)


def backward_rate(y):
    """−d/dt of (θ, ω, λ₁, λ₂), and the cost rate."""
    theta, omega, first, second = y[:4]
    u = np.clip(-second / 2, -1, 1)
    return np.stack([-omega, np.sin(theta) - u, -second * np.cos(theta), first, 1 + u**2])


def step(y, h):
    a = backward_rate(y)
    b = backward_rate(y + h / 2 * a)
    c = backward_rate(y + h / 2 * b)
    return y + h / 6 * (a + 2 * b + 2 * c + backward_rate(y + h * c))


def at_the_goal(multipliers):
    zero = np.zeros_like(multipliers)
    return np.stack([zero + np.pi, zero, multipliers, zero - 2, zero])


def offset(state, target):
    """``state`` − ``target``, the angle modulo 2π."""
    return np.stack([(state[0] - target[0] + np.pi) % (2 * np.pi) - np.pi, state[1] - target[1]])


@pytest.fixture(scope="module")
def extremals():
    """States on all extremals, (STEPS + 1, 2, multipliers)."""
    y = at_the_goal(MULTIPLIERS)
    states = [y[:2]]
    for _ in range(STEPS):
        y = step(y, STEP)
        states.append(y[:2])
    return np.stack(states)


def crossings(extremals, target):
    """Where the cells of the grid (time, λ₁) enclose ``target``: rows and columns."""
    d = offset(np.moveaxis(extremals, 1, 0), target[:, None, None])
    corners = d[:, :-1, :-1], d[:, :-1, 1:], d[:, 1:, 1:], d[:, 1:, :-1]
    close = np.nonzero((np.abs(corners[0]) < 1.0).all(axis=0))
    a, b, c, e = (corner[:, close[0], close[1]] for corner in corners)
    positive = sum((x[0] * y[1] > x[1] * y[0]).astype(int) for x, y in ((a, b), (b, c), (c, e), (e, a)))
    whole = np.maximum(np.abs(c - a), np.abs(e - b)).max(axis=0) < 1.0  # not across the seam of the angle
    found = whole & ((positive == 4) | (positive == 0))
    return close[0][found], close[1][found]


def refined_cost(row, column, target):
    """Cost of the extremal through ``target`` near a cell, by Newton's method in (λ₁, time); +inf if it diverges."""
    first, duration = MULTIPLIERS[column : column + 2].mean(), (row + 0.5) * STEP
    width = np.diff(MULTIPLIERS[column : column + 2])[0]
    for _ in range(12):
        small = 1e-6 * max(1.0, abs(first))
        y, steps = at_the_goal(np.array([first, first + small, first - small])), max(1, int(duration / STEP))
        for _ in range(steps):
            y = step(y, duration / steps)
        residual = offset(y[:2, 0], target)
        if np.abs(residual).max() < 1e-9:
            return y[4, 0]
        jacobian = np.column_stack([(y[:2, 1] - y[:2, 2]) / (2 * small), backward_rate(y[:, :1])[:2, 0]])
        change = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        first += np.clip(change[0], -5 * width, 5 * width)
        duration = max(duration + np.clip(change[1], -0.1, 0.1), 1e-4)
    return np.inf


def exact_optimum(extremals, p):
    mirrored = np.array([2 * np.pi - p[0], -p[1]])
    costs = [
        refined_cost(row, column, target)
        for target in (p, mirrored)
        for row, column in zip(*crossings(extremals, target))
    ]
    return min(costs)


def check(extremals, split, rows):
    shipped = reference.load(PENDULUM, split)
    for row in rows:
        difference = shipped.cost[row] / exact_optimum(extremals, shipped.parameters[row]) - 1
        assert -1e-4 < difference < 1e-3, shipped.parameters[row]


@pytest.mark.parametrize("split", ["validation", "boundary"])
def test_shipped_optima_are_global(extremals, split):
    check(extremals, split, range(5))


@pytest.mark.slow
@pytest.mark.parametrize("split", ["validation", "development", "boundary"])
def test_many_shipped_optima_are_global(extremals, split):
    check(extremals, split, range(5, 105))
