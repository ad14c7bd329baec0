"""Several hundred damaged databases: each is refused, or says the same as before."""

import functools
import json
import shutil

import numpy as np
import pytest

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError
from ocp_envs.sets.sampling import sample
from tests.data.damage import (
    attributes,
    damaged,
    everything,
    flips,
    metadata,
    pieces,
    tally,
    texts,
    write_first_version,
)
from tests.data.test_database import made_up
from tests.small_problems import WALLED_INTEGRATOR

ARRAYS = ("parameters", "order", "status", "slot_status", "cost", "z", "multipliers")
COUNTS = ("solves", "failures", "fallbacks", "iterations")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A finished database with a path constraint, five rows in chunks of two."""
    order = np.random.default_rng(3).permutation(5)
    path = tmp_path_factory.mktemp("damage") / "d.zarr"
    database = Database.create(path, WALLED_INTEGRATOR, sample(WALLED_INTEGRATOR, 1, 5), order=order, chunk=2)
    rows = made_up(WALLED_INTEGRATOR, database.parameters)
    for chunk in range(database.chunks):
        database.write(chunk, rows[order[database.stored_rows(chunk)]])
    return path


@pytest.fixture(scope="module")
def older(whole):
    """The same, as the first version of the format was."""
    path = whole.with_name("older.zarr")
    write_first_version(path, Database.open(whole, WALLED_INTEGRATOR))
    return path


def read(path):
    return functools.partial(everything, path, WALLED_INTEGRATOR)


def check(found, count):
    """All of at least ``count`` damaged databases are refused, or say the same."""
    assert set(found) <= {"refused", "same"}
    assert found["refused"] >= count


@pytest.mark.parametrize("name", ["", *ARRAYS, *COUNTS])
def test_damaged_descriptions_are_refused(whole, name):
    file = whole / name / "zarr.json"
    check(tally([file], texts, read(whole)) + tally([file], flips, read(whole)), 20)


@pytest.mark.parametrize("name", ["parameters", "z", "failures"])
def test_descriptions_of_arrays_are_those_that_were_declared(whole, name):
    check(tally([whole / name / "zarr.json"], metadata, read(whole)), 100)


def test_attributes_that_were_edited_are_refused(whole):
    check(tally([whole / "zarr.json"], attributes, read(whole)), 100)


@pytest.mark.parametrize("name", [*ARRAYS, *COUNTS])
def test_damaged_pieces_are_refused(whole, name):
    files = [file for file in (whole / name / "c").rglob("*") if file.is_file()]
    check(tally(files[:1], pieces, read(whole)), 10)
    check(tally(files, lambda content: iter([None]), read(whole)), len(files))


def test_messages_say_what_was_found_what_was_expected_and_what_helps(whole):
    file = whole / "z" / "zarr.json"
    other = json.dumps(json.loads(file.read_text()) | {"shape": [5, 1, 7]}).encode()
    expected = rf"got shape \(5, 1, 7\), expected \(5, 1, {WALLED_INTEGRATOR.flat_size}\); restore it .*, or generate"
    with damaged(file, other), pytest.raises(DatabaseError, match=expected):
        Database.open(whole, WALLED_INTEGRATOR)


# -- the first version of the format -----------------------------------------------------------------------------------


def test_databases_of_the_first_version_are_read_as_ever(whole, older):
    assert len(list(older.rglob("*"))) < len(list(whole.rglob("*")))  # pieces of initial values were not written
    assert everything(older, WALLED_INTEGRATOR) == everything(whole, WALLED_INTEGRATOR)


def test_what_the_first_version_cannot_tell_is_no_foreign_error_either(older):
    """It has no checksum of parameters, of order and of its attributes."""
    descriptions = [older / name / "zarr.json" for name in ("", "parameters", "order", "z")]
    found = tally(descriptions, texts, read(older)) + tally(descriptions[1:2], metadata, read(older))
    check(found, 150)
    given = [older / "parameters/c/0/0", older / "order/c/0"]
    found = tally([older / "zarr.json"], attributes, read(older)) + tally(given, pieces, read(older))
    assert set(found) <= {"refused", "same", "changed"}
    assert found["refused"] > 50


def test_a_database_of_the_first_version_is_finished_and_does_not_grow(older, tmp_path):
    path = shutil.copytree(older, tmp_path / "d")
    (path / "status" / "c" / "1").unlink()
    database = Database.open(path, WALLED_INTEGRATOR)
    assert not database.complete
    database.write(1, Database.open(older, WALLED_INTEGRATOR).stored(slice(2, 4)))
    assert everything(path, WALLED_INTEGRATOR) == everything(older, WALLED_INTEGRATOR)
    with pytest.raises(DatabaseError, match="has format version 1 and cannot grow"):
        database.grow(database.parameters[:1], [5])
