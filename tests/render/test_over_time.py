"""Plots against time."""

from __future__ import annotations

import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

from matplotlib import pyplot  # noqa: E402

from ocp_envs.problems.pendulum import PENDULUM  # noqa: E402
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE  # noqa: E402
from ocp_envs.render.over_time import plot_trajectory  # noqa: E402
from ocp_envs.trajectory import Trajectory  # noqa: E402


@pytest.mark.parametrize("problem", [PENDULUM, QUADCOPTER_OBSTACLE], ids=lambda p: p.id)
def test_trajectories_are_plotted_against_time(problem):
    nx, nu, knots = problem.system.nx, problem.system.nu, problem.knots
    generator = np.random.default_rng(0)
    trajectory = Trajectory(
        generator.normal(size=(3, knots, nx)), generator.uniform(size=(3, knots - 1, nu)), np.array([2.0, 3.0, 4.0])
    )
    axes = plot_trajectory(problem, trajectory)
    assert axes.shape == (nx + nu,)
    for i in range(nx):
        drawn = axes[i].lines[1]
        np.testing.assert_array_equal(drawn.get_ydata(), trajectory.states[1, :, i])
        np.testing.assert_allclose(drawn.get_xdata(), np.linspace(0, 3.0, knots))
    np.testing.assert_array_equal(axes[nx].lines[2].get_ydata()[:-1], trajectory.controls[2, :, 0])
    assert axes[0].get_ylabel() == ("theta (rad)" if problem is PENDULUM else "x (m)")
    again = plot_trajectory(problem, trajectory[0], axes)
    assert again[0].figure is axes[0].figure
    with pytest.raises(ValueError, match=f"expected {nx + nu} axes"):
        plot_trajectory(problem, trajectory, axes[:1])
    pyplot.close(axes[0].figure)
