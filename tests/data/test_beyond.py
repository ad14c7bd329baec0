import numpy as np
import pytest

from ocp_envs.data.beyond import beyond
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.samples import Samples
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR as PROBLEM

COUNT = 21


def lines(p, side):
    """Trajectories of the family ``side`` (B,), −1 or 1, from ``p`` (B, 2): its sign is that of their first control."""
    knots = PROBLEM.knots
    states = p[:, None] * np.linspace(1, 0, knots)[:, None]
    controls = np.zeros((len(p), knots - 1, 1))
    controls[:, 0, 0] = side
    states[:, 1:-1, 0] += 0.5 * side[:, None]
    return Trajectory(states, controls, np.full(len(p), 1.0))


def along_a_line():
    """Samples on a line through the discontinuity at 0, the families of either side, and pairs of neighbours."""
    p = np.stack([np.linspace(-1, 1, COUNT), np.zeros(COUNT)], axis=1)
    families = (p[:, 0] > 0.01).astype(int)
    samples = Samples.of(PROBLEM, p, lines(p, 2 * families - 1), np.zeros(COUNT, int))
    return samples, families, neighbour_pairs(PROBLEM.parameters, p, 2)


def continuing(monkeypatch, ends=np.inf):
    """A solver that stays in the family of its guess as far as ``ends`` beyond the border, at a cost that grows."""
    cost = lambda p, side: 1 + np.maximum(-side * p[:, 0], 0.0)  # noqa: E731
    monkeypatch.setattr(
        "ocp_envs.data.beyond.residuals", lambda problem, p, z: (None, cost(p, np.sign(z.controls[:, 0, 0])))
    )

    def solve(p, guess):
        side = np.sign(guess.controls[:, 0, 0])
        side = np.where(-side * p[:, 0] > ends, -side, side)
        return lines(p, side), cost(p, side)

    return solve


def test_families_are_continued_as_far_as_their_cost_is_within_the_margin(monkeypatch):
    samples, families, pairs = along_a_line()
    found = beyond(samples, families, 0.35, pairs=pairs, solve=continuing(monkeypatch))
    x = samples.parameters[:, 0]
    np.testing.assert_array_equal(np.isfinite(found.cost), np.stack([x < 0.36, x > -0.36], axis=1))
    np.testing.assert_allclose(found.excess[np.isfinite(found.cost)].max(), 0.3)
    np.testing.assert_array_equal(np.sign(found.trajectory.controls[:, 0, 0]), 2 * found.family - 1)
    assert (families[found.rows] != found.family).all()


def test_a_family_ends_where_its_trajectory_leads_to_that_of_another(monkeypatch):
    samples, families, pairs = along_a_line()
    found = beyond(samples, families, 0.35, pairs=pairs, solve=continuing(monkeypatch, ends=0.15))
    assert np.abs(samples.parameters[found.rows, 0]).max() < 0.15
    assert found.solves > len(found.rows)


def test_without_borders_nothing_is_solved(monkeypatch):
    samples, families, pairs = along_a_line()
    found = beyond(samples, np.zeros_like(families), 0.35, pairs=pairs, solve=continuing(monkeypatch))
    assert (found.solves, len(found.rows), found.cost.shape) == (0, 0, (COUNT, 1))


@pytest.mark.parametrize("wrong", [[0, 1], np.full(COUNT, -2)])
def test_families_that_are_not_one_for_each_sample_are_refused(wrong):
    with pytest.raises(ValueError, match=r"families: expected integers \(21,\)"):
        beyond(along_a_line()[0], wrong)


def test_a_trajectory_of_no_family_is_not_continued_and_its_place_is_filled_by_its_neighbours(monkeypatch):
    samples, families, pairs = along_a_line()
    families[3] = -1
    found = beyond(samples, families, 0.35, pairs=pairs, solve=continuing(monkeypatch))
    assert np.isfinite(found.cost[3]).tolist() == [True, False]
    assert found.family[found.rows == 3].tolist() == [0]
    assert np.isfinite(found.excess[3, 0])
