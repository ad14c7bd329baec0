"""python -m ocp_envs.info: a database in words, and as one file of arrays."""

from __future__ import annotations

import numpy as np
import pytest

import ocp_envs
from ocp_envs import info
from ocp_envs.data.database import Database
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.problems.pendulum import PENDULUM


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "few.zarr"
    settings = GenerationSettings(first=8, chunk=4, starts=2)
    return ocp_envs.generate(PENDULUM, path, ocp_envs.sample(PENDULUM, 3, 8), workers=1, settings=settings)


def test_a_database_is_described(database, capsys):
    info.main([str(database.path)])
    shown = capsys.readouterr().out
    for text in (PENDULUM.id, "8: 8 solved", "theta_f = 3 pi: best of", "first 8", "median", "MB"):
        assert text in shown


def test_instances_that_are_not_solved_are_counted(tmp_path, capsys):
    empty = Database.create(tmp_path / "empty.zarr", PENDULUM, [[1.0, 0.0], [2.0, 0.0]])
    assert empty.status.tolist() == [-1, -1]
    info.main([str(empty.path)])
    shown = capsys.readouterr().out
    assert "2: 2 not solved yet" in shown
    assert "none known" in shown


def test_a_database_is_exported_as_arrays(database, tmp_path):
    info.main([str(database.path), "--npz", str(tmp_path / "few.npz")])
    with np.load(tmp_path / "few.npz") as arrays:
        np.testing.assert_array_equal(arrays["parameters"], database.parameters)
        np.testing.assert_array_equal(arrays["cost"], database.costs().min(axis=1))
        assert arrays["states"].shape == (8, PENDULUM.knots, 2)


def test_a_problem_is_described(capsys):
    info.main([PENDULUM.id])
    assert capsys.readouterr().out == ocp_envs.describe(PENDULUM)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "there is no database at nowhere"),
        (["nowhere", "--module", "no_such"], "No module named 'no_such'"),
    ],
)
def test_errors_are_one_line(arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        info.main(arguments)
    assert end.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
