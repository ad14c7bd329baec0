"""Families of made-up continuations: where a part is split; and of two small problems that are solved."""

import contextlib
import dataclasses
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from moe_policy.learning import clustering
from moe_policy.learning.clustering import cluster
from moe_policy.learning.families import families_of, steepness
from ocp_envs.data import continuation, generation, worker
from ocp_envs.data.continuation import Continuation
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.sets.sampling import sample
from ocp_envs.trajectory import Trajectory
from tests.data.running import InProcess
from tests.in_process import Solver
from tests.small_problems import LINEAR_QUADRATIC, TURN
from tests.synthetic import fake_samples

SAMPLES = fake_samples(count=400, modes=1)
P = SAMPLES.parameters / SAMPLES.problem.parameters.width
PAIRS = neighbour_pairs(SAMPLES.problem.parameters, SAMPLES.parameters, 8)
ALL = Continuation(PAIRS, *(np.zeros((len(PAIRS), 2), kind) for kind in (np.float32, np.float32, np.int32)))


def with_values(values):
    """The samples with flat trajectories that all have the entries ``values`` (M,)."""
    flat = np.repeat(values[:, None], SAMPLES.problem.flat_size, axis=1)
    return dataclasses.replace(SAMPLES, trajectory=Trajectory.from_flat(flat, SAMPLES.problem.knots, 2, 1))


def test_the_steepness_of_a_linear_map_is_its_slope_along_the_step():
    samples = with_values(5 * P[:, 0])
    step = P[PAIRS[:, 0]] - P[PAIRS[:, 1]]
    expected = np.abs(step[:, 0]) / np.linalg.norm(step, axis=1) / P[:, 0].std() * np.sqrt(75)
    np.testing.assert_allclose(steepness(samples, PAIRS), expected, rtol=1e-9)


def test_copies_of_an_instance_are_flat_or_infinitely_steep():
    values = np.arange(400.0)
    values[2] = values[1]
    samples = with_values(values)
    samples = dataclasses.replace(samples, parameters=np.where(np.arange(400)[:, None] < 3, P[0], P))
    assert steepness(samples, np.array([[1, 2], [0, 1]])).tolist() == [0.0, np.inf]


def test_a_family_is_not_split_where_the_optimum_changes_evenly():
    for values in (P[:, 0], P[:, 0] + P[:, 1] ** 2, np.zeros(400)):
        assert families_of(with_values(values), ALL).values.max() == 0


@pytest.mark.parametrize("border", [0.4, 0.5, 0.7])
def test_a_family_is_split_exactly_where_the_optimum_changes_fast(border):
    """All neighbours continue into each other, also across the border, and it need not be in the middle."""
    above = P[:, 0] > border
    parts = families_of(with_values(P[:, 0] + 3 * above), ALL)
    assert parts.values.max() == 1
    assert len({*zip(parts.values.tolist(), above.tolist())}) == 2
    assert parts.accepted[0].width < 0.01 < 0.1 < parts.rejected[0].width


def test_a_family_that_bends_fast_in_one_place_is_split_into_as_many_parts_as_wanted():
    samples = with_values(P[:, 0])
    assert [int(families_of(samples, ALL, least=least).values.max()) + 1 for least in (1, 2, 5)] == [1, 2, 5]


@pytest.mark.parametrize("lost", np.abs(P[:, 0] - 0.5).argsort()[:3].tolist())
def test_an_instance_that_no_neighbour_leads_to_is_of_the_family_of_the_nearest_trajectory(lost):
    """Its place is among the other family."""
    above = P[:, 0] > 0.5
    values = P[:, 0] + 3 * above
    values[lost] = P[lost, 0] + 3 * ~above[lost]
    distance = np.where((PAIRS == lost).any(axis=1) | (above[PAIRS[:, 0]] != above[PAIRS[:, 1]]), 1.0, 0.0)
    alone = dataclasses.replace(ALL, distance=np.repeat(distance[:, None], 2, axis=1).astype(np.float32))
    parts = families_of(with_values(values), alone)
    assert parts.components[-1] == parts.moved.sum() == 1
    others = np.arange(400) != lost
    assert {parts.values[lost]} == {*parts.values[others & (above != above[lost])]}


def labels_of(problem, folder, monkeypatch):
    """A database of ``problem``, and the families that are found in it."""
    monkeypatch.setenv("PATH", "")  # no compiler
    monkeypatch.setattr(worker, "GuardedSolver", Solver)
    monkeypatch.setattr(worker, "KEPT", threading.local())
    for module in (generation, continuation):  # there it compiles only
        monkeypatch.setattr(module, "GuardedSolver", lambda *_: contextlib.nullcontext(Mock()))
    settings = GenerationSettings(first=60, chunk=60, starts=1)
    p, executor = sample(problem, 7, 60), InProcess()
    database = generation.generate(problem, folder / "training.zarr", p, executor=executor, settings=settings)
    return database.samples(), cluster(database, "continuation", executor=executor)


def test_turning_left_and_right_are_found_without_being_declared(tmp_path, monkeypatch):
    samples, labels = labels_of(TURN, tmp_path, monkeypatch)
    assert len(samples.problem.modes) == 1
    left = samples.trajectory.states[:, -1, 0] < 0
    assert labels.k == 2
    assert len({*zip(labels.values.tolist(), left.tolist())}) == 2
    assert len(list((tmp_path / "training.continuation").glob("*.zarr"))) == 1


def test_a_linear_quadratic_problem_has_one_family(tmp_path, monkeypatch):
    _, labels = labels_of(LINEAR_QUADRATIC, tmp_path, monkeypatch)
    assert labels.k == 1


@pytest.mark.parametrize("families", [1, 2])
def test_where_scouts_are_one_family_the_others_are_not_compared(monkeypatch, families):
    samples = with_values(P[:, 0] + (3 * (P[:, 0] > 0.5) if families == 2 else 0))
    compared = []

    def continued(of, kept, neighbours, executor):
        compared.append(len(of))
        pairs = neighbour_pairs(of.problem.parameters, of.parameters, neighbours)
        return Continuation(pairs, *(np.zeros((len(pairs), 2), kind) for kind in (np.float32, np.float32, np.int32)))

    monkeypatch.setattr(clustering, "SCOUTS", 200)
    monkeypatch.setattr(clustering, "continued", continued)
    labels = cluster(samples, "continuation")
    assert (labels.k, len(labels)) == (families, 400)
    assert compared == ([200] if families == 1 else [200, 400])
    assert ("scouts" in labels.settings) == (families == 1)
