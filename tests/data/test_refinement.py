import dataclasses
import threading

import cloudpickle
import numpy as np
import pytest

from ocp_envs.data import generation, refinement, worker
from ocp_envs.data.database import Database
from ocp_envs.data.generation import generate
from ocp_envs.data.layout import DatabaseError
from ocp_envs.data.refined import better
from ocp_envs.data.refinement import REFINED, _Task, refine, refine_chunk
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.nlp import Status
from ocp_envs.trajectory import Trajectory
from tests.data.running import InProcess
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURNING

#: One guess for each winding, in chunks of four.
QUICK = GenerationSettings(first=4, chunk=4, starts=1, neighbours=1, lookaround=1)
COUNT = 10


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch):
    for module in (worker, generation, refinement):
        monkeypatch.setattr(module, "GuardedSolver", Solver)
    monkeypatch.setattr(worker, "KEPT", threading.local())


def lines_to(winding):
    """A planner of straight lines to one winding of the goal."""

    def plan(p):
        return guesses(TURNING, p, np.full(len(p), winding), np.random.default_rng(0), "line")

    return plan


@pytest.fixture
def poor(tmp_path):
    """A finished database that has only the first of two families."""
    poor = Database.create(tmp_path / "poor", TURNING, sample(TURNING, 0, COUNT), chunk=4)
    payload = cloudpickle.dumps(TURNING)
    for chunk in range(poor.chunks):
        p = poor.stored_parameters(poor.stored_rows(chunk))
        poor.write(chunk, refine_chunk(_Task(0, payload, QUICK.solver, p, [lines_to(0)(p)])))
    return Database.open(poor.path, TURNING)


def test_what_a_planner_leads_to_is_kept_where_it_is_cheaper(poor, tmp_path):
    found = refine(poor, lines_to(1), tmp_path / "refined", executor=InProcess())
    np.testing.assert_array_equal(found.before, poor.costs())
    np.testing.assert_array_equal(found.after, found.database.costs())
    assert (found.after <= found.before).all()
    assert np.isfinite(found.after).sum() > np.isfinite(found.before).sum()
    samples = found.database.samples()
    assert verify(TURNING, samples.parameters, samples.trajectory, samples.cost).passed.all()
    assert found.improved.any()
    assert found.mean_costs[1] < found.mean_costs[0]
    assert found.change < 0
    assert "cheaper by more than 0.1 %" in repr(found)
    np.testing.assert_array_equal(poor.costs(), Database.open(poor.path, TURNING).costs())


def test_alternatives_of_a_planner_are_all_tried(poor, tmp_path):
    class Mixture:
        problem, name = TURNING, "mixture"

        def __call__(self, p):
            raise AssertionError("the plan that the gate chooses is one of the alternatives")

        def alternatives(self, p):
            return lines_to(0)(p), lines_to(1)(p)

    several = refine(poor, Mixture(), tmp_path / "a", executor=InProcess())
    one_by_one = refine(poor, lines_to(1), tmp_path / "b", executor=InProcess())
    np.testing.assert_allclose(several.after, one_by_one.after, rtol=1e-6)
    assert several.database.settings[REFINED][0]["planner"] == "mixture"


def test_the_better_of_two_is_kept_family_by_family(poor):
    rows = poor.stored(slice(0, 4))
    worse = rows.cost + np.array([1.0, 0.0])
    kept = better(rows, dataclasses.replace(rows, cost=worse))
    np.testing.assert_array_equal(kept.cost, rows.cost)
    np.testing.assert_array_equal(kept.solves, 2 * rows.solves)
    np.testing.assert_array_equal(kept.status, rows.status)


def test_an_interrupted_refinement_continues(poor, tmp_path, monkeypatch):
    whole = refine(poor, lines_to(1), tmp_path / "whole again", executor=InProcess())
    written = []

    def write(self, chunk, rows):
        if written:
            raise KeyboardInterrupt
        written.append(chunk)
        return Database.__mro__[1].write(self, chunk, rows)

    with monkeypatch.context() as patch:
        patch.setattr(Database, "write", write, raising=False)
        with pytest.raises(KeyboardInterrupt):
            refine(poor, lines_to(1), tmp_path / "refined", executor=InProcess())
    executor = InProcess()
    found = refine(poor, lines_to(1), tmp_path / "refined", executor=executor)
    assert len(executor.tasks) == poor.chunks - 1
    assert found.database.digest() == whole.database.digest()
    assert refine(poor, lines_to(1), tmp_path / "refined", executor=None).database.digest() == whole.database.digest()


def test_a_plan_that_is_not_finite_is_left_out(poor, tmp_path):
    def broken(p):
        return Trajectory(*(np.full_like(part, np.nan) for part in vars(lines_to(0)(p)).values()))

    found = refine(poor, broken, tmp_path / "refined", executor=InProcess())
    np.testing.assert_array_equal(found.after, found.before)
    assert not found.improved.any()
    assert (found.database.stored(slice(0, COUNT)).status == poor.stored(slice(0, COUNT)).status).all()


def test_what_cannot_be_refined_is_refused(poor, tmp_path):
    with pytest.raises(DatabaseError, match="not finished; generate it first"):
        refine(Database.create(tmp_path / "new", TURNING, poor.parameters), lines_to(0), tmp_path / "refined")
    with pytest.raises(DatabaseError, match=r"was not refined from .* with these plans; remove it"):
        refine(poor, lines_to(0), poor.path)
    with pytest.raises(TypeError, match="planner: expected trajectories"):
        refine(poor, lambda p: None, tmp_path / "refined")

    class Other:
        problem = DOUBLE_INTEGRATOR

        def __call__(self, p):
            return lines_to(0)(p)

    with pytest.raises(ValueError, match="belongs to DoubleIntegrator-v0, not to Turn-v0"):
        refine(poor, Other(), tmp_path / "refined")


def test_a_refined_database_does_not_grow(tmp_path):
    p = sample(TURNING, 0, 6)
    how = {"executor": InProcess(), "settings": QUICK}
    database = generate(TURNING, tmp_path / "d", p[:4], **how)
    refined = refine(database, lines_to(0), tmp_path / "refined", executor=InProcess()).database
    assert refined.key != database.key
    assert (refined.stored(slice(0, 4)).status == Status.SOLVED).all()
    with pytest.raises(DatabaseError, match="was refined, and refined databases do not grow"):
        generate(TURNING, tmp_path / "refined", p, **how)
