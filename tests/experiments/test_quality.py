"""The exhaustive search of data quality: what it searches, what it keeps, and how costs are compared with it."""

from concurrent.futures import Future

import numpy as np
import pytest

from moe_policy.experiments import quality
from moe_policy.experiments.quality import compare, exhaustive, widened
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from tests.in_process import Solver

CASES = np.array([[0.5, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
TARGETS = np.array([[-np.pi, 0.0], [np.pi, 0.0]])


def test_the_search_aims_at_more_windings_inside_the_operating_box():
    for problem in (PENDULUM, VEHICLE):
        more = widened(problem)
        assert {tuple(target) for target in problem.targets} < {tuple(target) for target in more.targets}
        assert more.system.state.contains(more.targets).all()


def test_an_instance_is_worse_or_better_by_more_than_the_tolerance():
    search = np.array([[10.0, 11.0], [12.0, 10.0], [10.0, np.inf], [np.inf, np.inf]])
    way = compare(np.array([10.005, 10.5, 9.0, 5.0]), search, CASES, TARGETS, tolerance=1e-3, seconds=2.0)
    assert (way.worse, way.better, way.unsolved, way.seconds) == (1, 2, 0, 2.0)
    assert way.share_worse == 0.25
    assert way.largest_excess == pytest.approx(0.05)
    (missed,) = way.cases
    assert (missed.parameters, missed.ours, missed.search) == ((1.0, 0.0), 10.5, 10.0)
    assert missed.target == tuple(TARGETS[1])


def test_an_unsolved_instance_is_worse_and_has_no_cost():
    way = compare(np.array([np.inf]), np.array([[10.0, 11.0]]), CASES[:1], TARGETS, tolerance=1e-3, seconds=0.0)
    assert (way.worse, way.unsolved, way.largest_excess) == (1, 1, None)
    assert way.cases[0].ours is None


class InProcess:
    """In place of a pool of processes: runs a task at once."""

    def __init__(self, workers):
        self.done = []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def submit(self, function, *arguments):

        future = Future()
        future.set_result(function(*arguments))
        return future


@pytest.fixture
def searched(monkeypatch):
    """Replaces the search by one whose costs are p[0] and p[0] + 1; the instances that it was given."""
    given = []

    def search(env_id, cases, count, seed):
        given.extend(cases[:, 0].tolist())
        return np.stack([cases[:, 0]] + [cases[:, 0] + 1] * (len(widened(PENDULUM).targets) - 1), axis=1)

    class Ready(Solver):
        def start(self):
            pass

    monkeypatch.setattr(quality, "_search", search)
    monkeypatch.setattr(quality, "_searcher", lambda env_id: Ready(PENDULUM))
    monkeypatch.setattr(quality, "WorkerPool", InProcess)
    return given


def test_an_interrupted_search_resumes_and_another_one_starts_from_the_beginning(searched, tmp_path):
    cases = np.linspace(0.5, 4.0, 12)[:, None] * [1.0, 0.0]
    store = tmp_path / "kept.npz"
    first = exhaustive(PENDULUM, cases[:10], 3, 1, store)
    assert searched == cases[:10, 0].tolist()
    searched.clear()
    more = exhaustive(PENDULUM, cases, 3, 1, store)
    assert searched == cases[10:, 0].tolist()
    np.testing.assert_array_equal(more[:10], first)
    np.testing.assert_array_equal(more[:, 0], cases[:, 0])
    searched.clear()
    exhaustive(PENDULUM, cases, 4, 1, store)
    assert searched == cases[:, 0].tolist()
