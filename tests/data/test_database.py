import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError, StoredRows
from ocp_envs.goal import winding_modes
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.nlp import Status
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

COUNT, CHUNK = 10, 4


def made_up(problem, parameters, seed=0):
    """Rows with arbitrary trajectories: the first problem has none, the others at least one."""
    rng = np.random.default_rng(seed)
    size, modes = len(parameters), len(problem.modes)
    have = rng.random((size, modes)) < 0.7
    have[:, 0] = True
    have[0] = False
    counts = {name: rng.integers(0, 9, size).astype(np.int32) for name in ("solves", "failures", "fallbacks")}
    return StoredRows(
        status=np.where(have.any(axis=1), Status.SOLVED, Status.NOT_CONVERGED).astype(np.int8),
        slot_status=np.where(have, Status.SOLVED, Status.EMPTY).astype(np.int8),
        cost=np.where(have, rng.random((size, modes)) + 1, np.inf),
        z=np.where(have[..., None], rng.random((size, modes, problem.flat_size)), np.nan),
        multipliers=rng.random((size, modes, problem.knots, problem.n_clearances)),
        iterations=np.full(size, 7, np.int32),
        **counts,
    )


@pytest.fixture
def order():
    return np.random.default_rng(3).permutation(COUNT)


@pytest.fixture
def empty(tmp_path, order):
    return Database.create(tmp_path / "d.zarr", PENDULUM, sample(PENDULUM, 1, COUNT), order=order, chunk=CHUNK)


@pytest.fixture
def filled(empty, order):
    rows = made_up(PENDULUM, empty.parameters)
    for chunk in range(empty.chunks):
        empty.write(chunk, rows[order[empty.stored_rows(chunk)]])
    return Database.open(empty.path), rows


# -- reading and writing -----------------------------------------------------------------------------------------------


def test_rows_come_back_in_the_order_in_which_they_are_stored(filled, order):
    database, rows = filled
    assert database.complete
    assert len(database) == COUNT
    np.testing.assert_array_equal(database.parameters, sample(PENDULUM, 1, COUNT))
    for name, value in vars(rows).items():
        np.testing.assert_array_equal(getattr(database.stored(slice(0, COUNT)), name), value[order], err_msg=name)
        np.testing.assert_array_equal(getattr(database.stored(slice(4, 8)), name), value[order[4:8]], err_msg=name)


def test_samples_are_the_cheapest_trajectories_of_solved_problems(filled):
    database, rows = filled
    samples = database.samples()
    np.testing.assert_array_equal(samples.index, np.arange(1, COUNT))
    np.testing.assert_array_equal(samples.parameters, database.parameters[1:])
    np.testing.assert_array_equal(samples.mode_costs, rows.cost[1:])
    for i in range(len(samples)):
        mode = min(range(3), key=lambda m: rows.cost[i + 1, m])
        assert (samples.mode[i], samples.cost[i]) == (mode, rows.cost[i + 1, mode])
        np.testing.assert_array_equal(samples.trajectory[i].flat()[0], rows.z[i + 1, mode])
    np.testing.assert_array_equal(database.samples([5, 0, 3]).index, [5, 3])


def test_reading_in_blocks_changes_nothing(filled, monkeypatch):
    """Memory is bounded by a block, which is a whole number of chunks."""
    database, rows = filled
    whole, digest = database.samples(), database.digest()
    monkeypatch.setattr("ocp_envs.data.database._BLOCK", CHUNK)
    blocks = [where for where, _ in database.blocks()]
    assert [(where.start, where.stop) for where in blocks] == [(0, 4), (4, 8), (8, 10)]
    assert [where.stop for where, _ in database.blocks(6)] == [4, 6]
    again = database.samples()
    for name in ("parameters", "cost", "mode", "mode_costs", "index"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    np.testing.assert_array_equal(again.trajectory.flat(), whole.trajectory.flat())
    np.testing.assert_array_equal(database.costs(), rows.cost)
    np.testing.assert_array_equal(database.samples([9, 1, 4]).mode_costs, rows.cost[[9, 1, 4]])
    assert database.digest() == digest


def test_the_key_tells_what_a_database_was_made_from(empty, order, tmp_path):
    p = sample(PENDULUM, 1, COUNT)
    same = Database.create(tmp_path / "same", PENDULUM, p, order=order, chunk=CHUNK)
    assert same.key == empty.key
    moved = Database.create(tmp_path / "moved", PENDULUM, p + 1e-9, chunk=CHUNK)
    other = Database.create(tmp_path / "other", PENDULUM, p, chunk=CHUNK, settings={"seed": 3})
    assert len({empty.key, moved.key, other.key}) == 3


def test_samples_can_be_sliced(filled):
    samples = filled[0].samples()
    chosen = samples[samples.mode == 0]
    assert len(chosen) == (samples.mode == 0).sum()
    np.testing.assert_array_equal(chosen.trajectory.flat(), samples.trajectory.flat()[samples.mode == 0])
    assert chosen.problem is samples.problem


def test_samples_must_fit_each_other_and_their_problem(filled):
    samples = filled[0].samples()
    with pytest.raises(ValueError, match=r"equal numbers of rows, got parameters \(5, 2\), trajectory 9"):
        replace(samples, parameters=samples.parameters[:5])
    with pytest.raises(ValueError, match=r"expected trajectories of DoubleIntegrator-v0 with states \(21, 2\)"):
        replace(samples, problem=DOUBLE_INTEGRATOR)


def test_multipliers_of_a_path_constraint_are_kept(tmp_path):
    p = sample(WALLED_INTEGRATOR, 0, 3)
    rows = made_up(WALLED_INTEGRATOR, p)
    database = Database.create(tmp_path / "d", WALLED_INTEGRATOR, p)
    database.write(0, rows)
    np.testing.assert_array_equal(database.samples().multipliers, rows.multipliers[1:, 0])


def test_totals_and_digest(filled, empty):
    database, rows = filled
    totals = database.totals()
    assert totals["problems"] == COUNT
    assert totals["solved"] == COUNT - 1
    assert totals["solves"] == rows.solves.sum()
    before = database.digest()
    assert Database.open(database.path).digest() == before
    changed = made_up(PENDULUM, database.parameters, seed=9)
    database.write(0, changed[:CHUNK])
    assert database.digest() != before


# -- growth ------------------------------------------------------------------------------------------------------------


def grown(database, size, rows):
    """The finished ``database`` with the first of ``rows`` up to ``size``, in order of their indices."""
    p = sample(PENDULUM, 1, 40)
    known = len(database)
    database = database.grow(p[known:size], np.arange(known, size))
    for chunk in np.flatnonzero(~database.present()):
        database.write(chunk, rows[database.missing_rows(chunk)])
    return database


@pytest.fixture
def small(tmp_path):
    """A finished database of six rows, and forty of which they are the first."""
    p = sample(PENDULUM, 1, 40)
    rows = made_up(PENDULUM, p)
    database = Database.create(tmp_path / "small", PENDULUM, p[:6], chunk=CHUNK)
    for chunk in range(2):
        database.write(chunk, rows[:6][database.stored_rows(chunk)])
    return database, rows


def test_what_is_stored_stays_when_a_database_grows(small):
    database, rows = small
    for size in (7, 8, 9, 20):
        database = grown(database, size, rows)
        assert (len(database), database.complete) == (size, True)
        again = Database.open(database.path)
        for name, value in vars(again.stored(slice(0, size))).items():
            np.testing.assert_array_equal(value, getattr(rows, name)[:size], err_msg=name)
        np.testing.assert_array_equal(again.parameters, sample(PENDULUM, 1, 40)[:size])


class KilledError(BaseException):
    """Stands for the end of the process."""


@pytest.mark.parametrize(("moment", "then"), [(0, 13), (1, 17), (7, 13), (12, 17), (16, 17)])
def test_growth_that_was_interrupted_goes_on_also_to_another_size(small, monkeypatch, moment, then):
    """At writes of the description, of the arrays' sizes, of parameters and of order."""
    database, rows = small
    interrupted, count, synced = copied(database, "interrupted"), iter(range(1000)), os.fsync

    def killed(descriptor):
        if next(count) == moment:
            raise KilledError
        synced(descriptor)

    monkeypatch.setattr(os, "fsync", killed)
    with pytest.raises(KilledError):
        interrupted.grow(sample(PENDULUM, 1, 40)[6:13], np.arange(6, 13))
    monkeypatch.setattr(os, "fsync", synced)
    left = Database.open(interrupted.path)
    assert len(left) == 6
    assert left.complete
    assert grown(left, then, rows).digest() == grown(database, then, rows).digest()


def copied(database, name):
    """A copy of ``database`` in a folder of that ``name``."""
    return Database.open(shutil.copytree(database.path, database.path.with_name(name)))


# -- interrupted and damaged files -------------------------------------------------------------------------------------


@pytest.fixture
def unfinished(empty, order):
    """A database without its last chunk."""
    rows = made_up(PENDULUM, empty.parameters)
    for chunk in range(2):
        empty.write(chunk, rows[order[empty.stored_rows(chunk)]])
    return empty, rows


@pytest.mark.parametrize("name", ["status/c/1", "z/c/1/0/0", "failures/c/1"])
def test_a_chunk_without_one_of_its_pieces_does_not_exist(unfinished, order, name):
    database, rows = unfinished
    (database.path / name).unlink()
    again = Database.open(database.path)
    np.testing.assert_array_equal(again.present(), [True, False, False])
    assert not again.complete
    assert again.totals()["problems"] == CHUNK
    for chunk in (1, 2):
        again.write(chunk, rows[order[again.stored_rows(chunk)]])
    np.testing.assert_array_equal(Database.open(database.path).costs(), rows.cost)


def test_a_finished_database_without_one_of_its_pieces_is_damaged(filled):
    (filled[0].path / "failures" / "c" / "1").unlink()
    with pytest.raises(DatabaseError, match="pieces of solved rows are missing; restore it from a copy, or generate"):
        Database.open(filled[0].path)


def test_rows_that_do_not_fit_a_chunk_are_refused(filled):
    database, rows = filled
    for wrong in (rows[:0], rows[: CHUNK + 1]):
        with pytest.raises(ValueError, match=f"chunk 1 has {CHUNK} rows, got {len(wrong)}"):
            database.write(1, wrong)


def test_the_first_problems_are_usable_before_the_database_is_complete(unfinished, order):
    database, _ = unfinished
    first = database.first(CHUNK + 1)
    np.testing.assert_array_equal(first, np.sort(order[: CHUNK + 1]))
    samples = database.samples(first)
    np.testing.assert_array_equal(samples.index, database.solved(first))
    with pytest.raises(DatabaseError, match=f"8 of the first {COUNT} instances are solved"):
        database.first(None)


def test_all_problems_of_a_complete_database_are_its_first(filled):
    np.testing.assert_array_equal(filled[0].first(None), np.arange(COUNT))


def test_what_an_interrupted_write_leaves_is_tolerated(filled):
    database, rows = filled
    (database.path / "z" / "c" / "0.1234.partial").write_bytes(b"half a chunk")
    (database.path / "zarr.5678.partial").write_bytes(b"{")
    np.testing.assert_array_equal(Database.open(database.path).costs(), rows.cost)


def damage_truncate(path):
    file = path / "cost" / "c" / "0" / "0"
    file.write_bytes(file.read_bytes()[:-7])


def damage_flip(path):
    file = path / "cost" / "c" / "0" / "0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(content)


def damage_remove_trajectories(path):
    (path / "z" / "c" / "0" / "0" / "0").unlink()


def damage_remove_slots(path):
    (path / "slot_status" / "c" / "0" / "0").unlink()


def damage_array(path):
    shutil.rmtree(path / "cost")


def damage_description(path):
    (path / "zarr.json").write_text("{")


@pytest.mark.parametrize(
    "damage",
    [
        damage_truncate,
        damage_flip,
        damage_remove_trajectories,
        damage_remove_slots,
        damage_array,
        damage_description,
    ],
)
def test_damage_is_an_error(filled, damage):
    path = filled[0].path
    damage(path)
    with pytest.raises(DatabaseError, match="damaged"):
        Database.open(path).samples()


def test_foreign_folders_are_refused(tmp_path):
    with pytest.raises(DatabaseError, match="no database at"):
        Database.open(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DatabaseError, match="not a database"):
        Database.open(tmp_path)
    with pytest.raises(DatabaseError, match="exists already"):
        Database.create(tmp_path, PENDULUM, sample(PENDULUM, 0, 3))
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_another_problem_is_refused(empty):
    with pytest.raises(DatabaseError, match=r"made for PendulumSwingup-v0 .* not for DoubleIntegrator-v0"):
        Database.open(empty.path, DOUBLE_INTEGRATOR)
    with pytest.raises(DatabaseError, match="has changed since"):
        Database.open(empty.path, PENDULUM.with_constants(mass=1.1))
    with pytest.raises(DatabaseError, match="declaration has changed since"):
        Database.open(empty.path, replace(PENDULUM, modes=winding_modes(("left", "middle", "right"))))


def test_an_order_must_be_a_permutation(tmp_path):
    with pytest.raises(ValueError, match="permutation"):
        Database.create(tmp_path / "d", PENDULUM, sample(PENDULUM, 0, 3), order=[0, 0, 1])
    assert not (tmp_path / "d").exists()
