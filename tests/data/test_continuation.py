import contextlib
import dataclasses
import json
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from ocp_envs.data import continuation, continuation_files, generation, worker
from ocp_envs.data.continuation import continued
from ocp_envs.data.generation import generate
from ocp_envs.data.layout import DatabaseError
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.sets.sampling import sample
from tests.data.running import InProcess
from tests.in_process import Solver
from tests.small_problems import LINEAR_QUADRATIC, TURN

SETTINGS = GenerationSettings(first=60, chunk=60, starts=1)
COUNT = 30


@pytest.fixture(scope="module", autouse=True)
def _in_process():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker, "GuardedSolver", Solver)
        for module in (generation, continuation):  # there it compiles only
            patch.setattr(module, "GuardedSolver", lambda problem, settings: contextlib.nullcontext(Mock()))
        patch.setattr(worker, "KEPT", threading.local())
        patch.setattr(continuation_files, "CHUNK", 40)
        yield


def solved(problem, folder, count=COUNT):
    p = sample(problem, 7, count)
    return generate(problem, folder / "d.zarr", p, executor=InProcess(), settings=SETTINGS).samples()


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    return solved(TURN, tmp_path_factory.mktemp("turn"))


@pytest.fixture(scope="module")
def continuing(turning):
    return continued(turning, executor=InProcess())


def least_squares_cost(p, steps=20, duration=5.0):
    """Cost of the least controls that bring a double integrator from ``p`` to rest at the origin: closed form."""
    h = duration / steps
    effect = np.array([[h * (duration - (k + 0.5) * h), h] for k in range(steps)]).T
    aim = -np.stack([p[:, 0] + duration * p[:, 1], p[:, 1]])
    controls = np.linalg.pinv(effect) @ aim
    return h / 2 * (controls**2).sum(axis=0)


def test_where_the_optimum_is_linear_in_the_parameters_all_neighbours_continue_into_each_other(tmp_path):
    samples = solved(LINEAR_QUADRATIC, tmp_path, 30)
    np.testing.assert_allclose(samples.cost, least_squares_cost(samples.parameters), rtol=1e-4, atol=2e-5)
    found = continued(samples, executor=InProcess())
    assert found.joined.all()
    assert found.distance.max() < 1e-3


def test_neighbours_that_turn_to_different_sides_do_not_continue_into_each_other(turning, continuing):
    left = turning.trajectory.states[:, -1, 0] < 0
    different = left[continuing.pairs[:, 0]] != left[continuing.pairs[:, 1]]
    assert 0 < different.sum() < len(different) / 2
    np.testing.assert_array_equal(continuing.joined, ~different)
    assert continuing.distance[different].min() > 1


def test_the_first_direction_is_from_the_first_to_the_second_and_the_other_one_back(turning, continuing):
    """Against solves one by one, of a pair that turns to different sides."""
    row = int(np.flatnonzero(~continuing.joined)[0])
    i, j = continuing.pairs[row]
    solver = Solver(TURN)
    for direction, (begin, at) in enumerate(((i, j), (j, i))):
        p, z = turning.parameters[[at]], turning.trajectory[[begin]].flat().astype(np.float32)
        found = solver.solve(p, worker.start_from(TURN, p, z), np.array([-1]))
        difference = np.abs(found.trajectory.states - turning.trajectory[[at]].states).max()
        assert continuing.distance[row, direction] == pytest.approx(difference, rel=1e-3)
        excess = found.cost[0] / turning.cost[at] - 1
        assert continuing.excess[row, direction] == pytest.approx(excess, rel=1e-3, abs=1e-6)
        assert continuing.iterations[row, direction] == found.iterations[0]


def test_every_solve_that_fails_agrees_with_nothing(turning, monkeypatch):
    def lost(problem, p, z):
        guess = worker.start_from(problem, p, z)
        return dataclasses.replace(guess, states=guess.states * np.nan)

    monkeypatch.setattr(continuation, "start_from", lost)
    found = continued(turning[:12], executor=InProcess())
    assert np.isinf(found.distance).all()
    assert not found.agrees.any()


class Interrupting(InProcess):
    """Stops at the third task."""

    def submit(self, fn, /, *args, **kwargs):
        if len(self.tasks) == 2:
            raise KeyboardInterrupt
        return super().submit(fn, *args, **kwargs)


def test_an_interrupted_pass_continues_and_a_finished_one_is_not_made_again(turning, continuing, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        continued(turning, tmp_path, executor=Interrupting(), workers=1)
    rest = InProcess()
    found = continued(turning, tmp_path, executor=rest)
    chunks = -(-len(found.pairs) // continuation_files.CHUNK)
    assert len(rest.tasks) == chunks - 2 > 0
    again = InProcess()
    same = continued(turning, tmp_path, executor=again)
    assert again.tasks == []
    for name in ("pairs", "distance", "excess", "iterations"):
        np.testing.assert_array_equal(getattr(found, name), getattr(continuing, name))
        np.testing.assert_array_equal(getattr(same, name), getattr(continuing, name))


def test_other_samples_have_results_of_their_own(turning, tmp_path):
    for samples in (turning[:12], turning[1:13]):
        continued(samples, tmp_path, executor=InProcess())
    assert len(list(tmp_path.glob("*.zarr"))) == 2


def test_results_that_were_edited_or_belong_elsewhere_are_refused(turning, tmp_path):
    samples = turning[:12]
    continued(samples, tmp_path, executor=InProcess())
    (path,) = tmp_path.glob("*.zarr")
    record = json.loads((path / "zarr.json").read_text())
    record["attributes"]["pairs"] += 1
    (path / "zarr.json").write_text(json.dumps(record))
    with pytest.raises(DatabaseError, match="checksum"):
        continued(samples, tmp_path, executor=InProcess())
    continued(turning[1:13], tmp_path / "other", executor=InProcess())
    (other,) = (tmp_path / "other").glob("*.zarr")
    (path / "zarr.json").write_text((other / "zarr.json").read_text())
    with pytest.raises(DatabaseError, match="not the continuation of these samples: got key"):
        continued(samples, tmp_path, executor=InProcess())


def test_a_lost_piece_is_made_again_and_a_damaged_one_refused(turning, tmp_path):
    whole = continued(turning, tmp_path, executor=InProcess())
    (path,) = tmp_path.glob("*.zarr")
    (path / "excess" / "c" / "1" / "0").unlink()
    executor = InProcess()
    np.testing.assert_array_equal(continued(turning, tmp_path, executor=executor).excess, whole.excess)
    assert len(executor.tasks) == 1
    piece = path / "distance" / "c" / "0" / "0"
    piece.write_bytes(bytes([piece.read_bytes()[0] ^ 255]) + piece.read_bytes()[1:])
    with pytest.raises(DatabaseError, match="damaged"):
        continued(turning, tmp_path, executor=InProcess())


@pytest.mark.parametrize("neighbours", [0, -1])
def test_a_wrong_number_of_neighbours_is_named(turning, neighbours):
    with pytest.raises(ValueError, match="neighbours: expected a whole number"):
        continued(turning, neighbours=neighbours)
