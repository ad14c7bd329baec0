"""Frames of recorded episodes, without a screen."""

from __future__ import annotations

import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")


from ocp_envs.problems.quadcopter import QUADCOPTER  # noqa: E402
from ocp_envs.render.film import Film  # noqa: E402
from ocp_envs.trajectory import Trajectory  # noqa: E402


def changed(a, b):
    return int((a != b).any(axis=2).sum())


def test_a_film_shows_the_announced_plan_until_the_next_episode():
    plan = np.zeros((20, 12))
    plan[:, :3] = np.linspace([-8.0, 6.0, -5.0], np.zeros(3), 20)
    film = Film(0.02, 2)
    film.begin(np.arange(2), plan[[0, 0]])
    before = film.frame(QUADCOPTER, 1, np.zeros(0))
    film.announce(np.array([1]), Trajectory(plan[None], np.zeros((1, 19, 4)), np.ones(1)))
    assert changed(film.frame(QUADCOPTER, 1, np.zeros(0)), before) > 100
    film.begin(np.array([1]), plan[:1])
    np.testing.assert_array_equal(film.frame(QUADCOPTER, 1, np.zeros(0)), before)
