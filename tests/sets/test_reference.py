import numpy as np
import pytest

from ocp_envs import tables
from ocp_envs.data.database import Database
from ocp_envs.distribution import Uniform
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets import reference
from ocp_envs.sets.reference import ReferenceDataError
from ocp_envs.sets.sampling import sample
from ocp_envs.sets.splits import sets_of
from tests.data.test_database import made_up
from tests.small_problems import DOUBLE_INTEGRATOR


@pytest.fixture
def database(tmp_path):
    """Five problems, all with a solution."""
    six = sample(PENDULUM, 1, 6)
    rows = made_up(PENDULUM, six)
    made = Database.create(tmp_path / "d", PENDULUM, six[1:])
    made.write(0, rows[1:])
    return made


def test_what_is_saved_is_loaded(database, tmp_path):
    path = reference.save(database, "validation", tmp_path)
    loaded = reference.load(PENDULUM, "validation", tmp_path)
    np.testing.assert_array_equal(loaded.parameters, database.parameters)
    np.testing.assert_array_equal(loaded.mode_costs, database.costs())
    np.testing.assert_array_equal(loaded.cost, database.samples().cost)
    np.testing.assert_array_equal(loaded.mode, database.samples().mode)
    assert [file.name for file in path.parent.iterdir()] == ["validation.npz"]  # no temporary files


def test_files_hold_no_pickles(database, tmp_path):
    with np.load(reference.save(database, "validation", tmp_path), allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


def test_an_unsolved_problem_cannot_be_a_reference(tmp_path):
    p = sample(PENDULUM, 1, 5)
    made = Database.create(tmp_path / "d", PENDULUM, p)
    made.write(0, made_up(PENDULUM, p))
    with pytest.raises(ReferenceDataError, match="1 of 5 instances have no solution"):
        reference.save(made, "validation", tmp_path)


def test_files_of_another_problem_or_none_are_refused(database, tmp_path):
    path = reference.save(database, "validation", tmp_path)
    with pytest.raises(ReferenceDataError, match="the problem has changed since"):
        reference.load(PENDULUM.with_constants(mass=1.1), "validation", tmp_path)
    with pytest.raises(ReferenceDataError, match=r"no reference set 'test' .* there are \['validation'\]"):
        reference.load(PENDULUM, "test", tmp_path)
    with pytest.raises(ReferenceDataError, match="no reference set"):
        reference.load(DOUBLE_INTEGRATOR, "validation", tmp_path)
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"something else"):
        path.write_bytes(damaged)
        with pytest.raises(ReferenceDataError, match="damaged"):
            reference.load(PENDULUM, "validation", tmp_path)


@pytest.mark.parametrize(
    ("arrays", "match"),
    [
        ({"parameters": np.zeros((3, 2))}, "'mode_costs' is missing"),
        (
            {"parameters": np.zeros((3, 2)), "mode_costs": np.zeros((2, 3))},
            r"equal numbers of rows, got parameters \(3, 2\), mode_costs \(2, 3\)",
        ),
        ({"parameters": np.zeros((3, 2)), "mode_costs": np.zeros((3, 2))}, "2 solution families, expected 2 and 3"),
        ({"parameters": np.zeros(3), "mode_costs": np.zeros((3, 3))}, r"shapes \(3,\)"),
    ],
)
def test_tables_of_other_shapes_are_no_reference(tmp_path, arrays, match):
    tables.save(PENDULUM, "validation", tmp_path, **arrays)
    with pytest.raises(ReferenceDataError, match=match):
        reference.load(PENDULUM, "validation", tmp_path)


# -- splits ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", [*BENCHMARK, DOUBLE_INTEGRATOR], ids=lambda problem: problem.id)
def test_splits_share_no_parameters(problem):
    limit = None if isinstance(problem.distribution, Uniform) else 300  # drawing takes an optimiser
    drawn = {name: split.parameters(problem, limit) for name, split in sets_of(problem).splits.items()}
    assert set(drawn) == {"training", *reference.SHIPPED}
    for p in drawn.values():
        assert len(problem.check_parameters(p)) > 0
    together = np.concatenate(list(drawn.values()))
    assert len(np.unique(together, axis=0)) == len(together)


def test_the_pendulum_has_the_papers_sets():
    assert {n: len(s.parameters(PENDULUM)) for n, s in sets_of(PENDULUM).splits.items()} == {
        "training": 1281,
        "development": 1000,
        "validation": 1000,
    }


def test_an_unknown_split_names_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'validation'"):
        sets_of(PENDULUM).split("validate")


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
@pytest.mark.parametrize("split", reference.SHIPPED)
def test_shipped_files_are_those_of_the_splits(problem, split):
    if not reference.path_of(problem, split).exists():
        pytest.skip("not shipped yet")
    shipped = reference.load(problem, split)
    assert len(shipped) == len(sets_of(problem).split(split))
    first = None if isinstance(problem.distribution, Uniform) else 300
    drawn = sets_of(problem).split(split).parameters(problem, first)
    np.testing.assert_allclose(shipped.parameters[: len(drawn)], drawn, rtol=1e-12)
    assert np.isfinite(shipped.cost).all()
