import dataclasses

import numpy as np
import pytest

from ocp_envs.data.probe import Probe, probe
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.sets.sampling import sample
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURN, WALLED_INTEGRATOR

SETTINGS = GenerationSettings(first=20, chunk=10, starts=3)


@pytest.fixture(scope="module")
def turning(interpreted):
    return probe(Solver(TURN), sample(TURN, 3, 4), SETTINGS)


def test_a_probe_says_how_many_guesses_find_the_lowest_cost(turning):
    assert turning.statuses == {"SOLVED": 4}
    assert turning.tried == 3
    assert len(turning.hits) == 4
    assert all(1 <= hits <= 3 for hits in turning.hits)
    assert 0 <= turning.failures <= 1
    assert turning.scatter >= 0
    assert f"of 3 guesses for each winding {np.mean(turning.hits):.1f} find the lowest cost" in turning.text


def test_times_are_those_of_an_instance(turning):
    assert 0 < turning.later < turning.first
    expectation = turning.expectation(first=20, workers=2)
    assert expectation.work(20) == pytest.approx(20 * turning.first)
    assert expectation.work(120) == pytest.approx(20 * turning.first + 100 * turning.later)
    assert expectation.left(0, 120, 0, 0.0) == pytest.approx(expectation.work(120) / 2)


def test_infeasible_instances_are_counted_and_not_solved(interpreted):
    found = probe(Solver(WALLED_INTEGRATOR), np.array([[3.0, -3.0], [3.0, 3.05]]), SETTINGS)
    assert found.statuses == {"SOLVED": 1, "INFEASIBLE": 1}


def test_nothing_may_be_solved(interpreted):
    hasty = dataclasses.replace(DOUBLE_INTEGRATOR, id="Hasty-v0", duration=(0.2, 0.5))
    found = probe(Solver(hasty), np.array([[4.0, 0.0], [5.0, 0.0]]), SETTINGS)
    assert "SOLVED" not in found.statuses
    assert (found.hits, found.improved, found.failures, found.later) == ((), 0, 1.0, found.first)
    assert "100% of the solves fail" in found.text


def test_what_a_single_guess_found_is_doubtful():
    found = Probe({"SOLVED": 3}, 8, (1, 4, 8), 0.1, 0.3, 0, 120.0, 0.05)
    assert found.doubtful == 1
    assert "1 of 3 lowest costs were found by one guess alone" in found.text
    assert "an instance of the first round takes 2 min on one core, a later one 50 ms" in found.text
    assert dataclasses.replace(found, hits=(2, 4, 8)).doubtful == 0
    assert dataclasses.replace(found, hits=(2, 4, 8), improved=2).doubtful == 2
