from __future__ import annotations

import dataclasses
import json
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import moe_policy
from moe_policy import store
from moe_policy.learning.clustering import cluster
from moe_policy.learning.settings import TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.networks import ARGMAX, Softmax, count_parameters
from moe_policy.planners.solver import SolverPlanner
from moe_policy.store import ModelFileError, UnknownModelError
from ocp_envs.problems import UnknownProblemError
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.trajectory import Trajectory
from tests.in_process import Solver
from tests.synthetic import fake_samples

QUICK = TrainingSettings(epochs=3)
SAMPLES = fake_samples(count=150, modes=3)
SINGLE = fit_single(SAMPLES, settings=QUICK)
MIXTURE = fit_mixture(SAMPLES, cluster(SAMPLES, "custom"), settings=QUICK)
NEAREST = NearestPlanner(SAMPLES)
PLANNERS = [SINGLE, MIXTURE, MIXTURE.with_mixing(Softmax(0.3)), NEAREST]
BOX = PENDULUM.parameters


@pytest.fixture
def saved(tmp_path):
    MIXTURE.save(tmp_path / "moe")
    return tmp_path / "moe"


# -- planning ------------------------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(PLANNERS), st.lists(st.tuples(st.floats(-10, 10), st.floats(-4, 4)), max_size=8))
def test_rows_do_not_depend_on_their_batch(planner, rows):
    p = np.array(rows).reshape(-1, 2)
    plan = planner(p)
    assert plan.states.shape == (len(p), 25, 2)
    assert plan.states.dtype == np.float64
    for i, row in enumerate(p):
        np.testing.assert_allclose(planner(row).flat()[0], plan.flat()[i], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("planner", PLANNERS)
def test_bad_parameters_are_named(planner):
    with pytest.raises(ValueError, match="finite"):
        planner([np.nan, 0.0])
    with pytest.raises(ValueError, match=r"\(B, 2\)"):
        planner(np.zeros((3, 4)))


def test_plans_of_a_mixture_are_those_of_the_chosen_experts():
    choice, probabilities = MIXTURE.gate(SAMPLES.parameters)
    np.testing.assert_array_equal(choice, probabilities.argmax(axis=1))
    np.testing.assert_allclose(probabilities.sum(axis=1), 1)
    experts = np.stack([plan.flat() for plan in MIXTURE.experts(SAMPLES.parameters)])
    plans = MIXTURE(SAMPLES.parameters).flat()
    np.testing.assert_allclose(plans, experts[choice, np.arange(len(choice))], atol=1e-4)
    soft = MIXTURE.with_mixing(Softmax(1.0))(SAMPLES.parameters).flat()
    np.testing.assert_allclose(soft, np.einsum("bk,kbr->br", probabilities, experts), atol=1e-4)
    assert MIXTURE.mixing == ARGMAX


def test_single_networks_have_no_gate():
    for call in (lambda: SINGLE.gate([0, 0]), lambda: SINGLE.experts([0, 0]), lambda: SINGLE.with_mixing(ARGMAX)):
        with pytest.raises(TypeError, match="single network"):
            call()


def test_parameter_counts():
    gate, expert = 3 * 50 + 51 * 3, 3 * 20 + 21 * 75
    assert SINGLE.parameters_total == SINGLE.parameters_active == count_parameters(SINGLE.network)
    assert MIXTURE.parameters_total == MIXTURE.with_mixing(Softmax()).parameters_active == gate + 3 * expert
    assert MIXTURE.parameters_active == gate + expert


def test_nearest_is_nearest_by_search():
    p = BOX.draw(np.random.default_rng(1), 40)
    distance = np.linalg.norm((p[:, None] - SAMPLES.parameters) / BOX.width, axis=2)
    np.testing.assert_array_equal(NEAREST.neighbours(p, 4), distance.argsort(axis=1)[:, :4])
    np.testing.assert_array_equal(NEAREST(p).flat(), SAMPLES.trajectory.flat()[distance.argmin(axis=1)])
    with pytest.raises(ValueError, match="1 … 150"):
        NEAREST.neighbours(p, 151)


# -- the program as a planner --------------------------------------------------------------------------------------


class Recorder:
    """Solves nothing: gives every guess back as its solution, at a cost that is its duration."""

    def __init__(self, solved=lambda p, duration: np.ones(len(duration), dtype=bool)):
        self.solved, self.calls, self.retried = solved, [], []

    def solve(self, parameters, guesses, windings, *, retry_with_fallback=True):
        self.calls.append((parameters, windings))
        self.retried.append(retry_with_fallback)
        failed = ~self.solved(parameters, guesses.duration)
        flat = guesses.flat()
        flat[failed] = np.nan
        cost = np.where(failed, np.inf, guesses.duration)
        zeros = np.zeros(len(flat))
        status = np.where(failed, 2, 1).astype(np.int8)
        return Solutions(
            Trajectory.from_flat(flat, 25, 2, 1), cost, zeros[:, None, None], status, zeros, zeros.astype(bool), zeros
        )


def test_the_cheapest_solution_is_the_plan_and_failures_are_nan():
    solver = Recorder(lambda p, duration: p[:, 0] < 3)
    everywhere = len(SAMPLES.parameters)
    planner = SolverPlanner(PENDULUM, SAMPLES, neighbours=2, lookaround=everywhere, starts=4, solver=solver)
    p = np.array([[1.0, 0.0], [4.0, 1.0], [2.0, -1.0]])
    plan, cost = planner.best(p)
    np.testing.assert_array_equal(plan.finite, [True, False, True])
    assert cost[1] == np.inf
    np.testing.assert_array_equal(plan.duration[[0, 2]], cost[[0, 2]])
    parameters, windings = solver.calls[0]
    for row in range(3):
        mine = (parameters == p[row]).all(axis=1)
        assert np.bincount(windings[mine] + 1).tolist() == [2 * 3, 4, 4, 4]  # neighbours of 3 modes, then windings


@pytest.mark.parametrize("database", [None, SAMPLES])
def test_plans_of_the_program_do_not_depend_on_the_batch(database):
    planner = SolverPlanner(PENDULUM, database, solver=Recorder())
    p = SAMPLES.parameters[:5] + 0.01
    whole = planner(p).flat()
    np.testing.assert_array_equal(np.concatenate([planner(row).flat() for row in p]), whole)
    assert len(planner(p[:0])) == 0


def test_warm_starts_come_from_the_modes_nearby():
    solver = Recorder()
    p = SAMPLES.parameters[[7]] + 1e-3
    SolverPlanner(PENDULUM, SAMPLES, neighbours=2, lookaround=5, solver=solver)(p)
    (_, windings) = solver.calls[0]
    near = np.argsort((((SAMPLES.parameters - p) / [2 * np.pi, 4]) ** 2).sum(axis=1))[:5]
    expected = np.minimum(np.bincount(SAMPLES.mode[near]), 2).sum()
    assert len(windings) == expected
    assert (windings == -1).all()


def test_what_no_warm_start_solves_is_tried_again_with_a_line_and_the_fallback():
    """The solver refuses whatever lasts as long as a stored trajectory, for one of two problems."""
    p = np.array([[1.0, 0.0], [4.0, 1.0]])
    solver = Recorder(lambda q, duration: (q[:, 0] < 3) | ~np.isin(duration, SAMPLES.trajectory.duration))
    plan, cost = SolverPlanner(PENDULUM, SAMPLES, solver=solver).best(p)
    assert plan.finite.all()
    np.testing.assert_array_equal(plan.duration, cost)
    assert np.isin(cost[0], SAMPLES.trajectory.duration)
    parameters, windings = solver.calls[1]
    assert len(solver.calls) == 2
    assert (parameters == p[1]).all()
    first, _ = solver.calls[0]
    warm = (first == p[1]).all(axis=1).sum()
    assert np.bincount(windings + 1).tolist() == [warm, 1, 1, 1]  # the warm starts, and a line to every winding
    assert solver.retried == [False, True]


def test_without_guesses_there_is_nothing_to_solve():
    with pytest.raises(ValueError, match="no guesses"):
        SolverPlanner(PENDULUM, starts=0, solver=Recorder())


@pytest.mark.slow
def test_the_program_plans_the_pendulum():
    planner = SolverPlanner(PENDULUM, solver=Solver(PENDULUM))
    plan, cost = planner.best([[0.0, 0.0], [np.pi, 0.1]])
    assert plan.finite.all()
    assert PENDULUM.goal_error(plan.states[:, -1]).max() < 1e-3
    assert cost[1] < cost[0]


# -- files ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_loaded_planner_plans_the_same(planner, tmp_path):
    planner.save(tmp_path / "new" / "softmax-0.1")
    for path in ("softmax-0.1", "softmax-0.1.json", "softmax-0.1.safetensors"):
        loaded = moe_policy.load_file(tmp_path / "new" / path)
        assert (loaded.name, loaded.problem) == (planner.name, PENDULUM)
        atol = 1e-5 if planner is NEAREST else 0  # stored in float32
        np.testing.assert_allclose(
            loaded(SAMPLES.parameters).flat(), planner(SAMPLES.parameters).flat(), rtol=0, atol=atol
        )
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["softmax-0.1.json", "softmax-0.1.safetensors"]


def test_how_a_planner_was_made_is_saved(saved):
    loaded = moe_policy.load_file(saved)
    assert loaded.details == json.loads(json.dumps(MIXTURE.details))
    assert loaded.details["clusters"]["sizes"] == np.bincount(SAMPLES.mode).tolist()
    record = json.loads(saved.with_suffix(".json").read_text())
    assert record["fingerprint"] == PENDULUM.fingerprint
    assert "versions" in record["provenance"]


@pytest.mark.parametrize("part", [".json", ".safetensors"])
def test_missing_and_truncated_files_are_named(saved, part):
    path = saved.with_suffix(part)
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"\x80\x04}q\x00."):
        path.write_bytes(damaged)
        with pytest.raises(ModelFileError, match=path.name):
            moe_policy.load_file(saved)
    path.unlink()
    with pytest.raises(ModelFileError, match="missing"):
        moe_policy.load_file(saved)


def test_a_flipped_byte_is_found(saved):
    path = saved.with_suffix(".safetensors")
    content = bytearray(path.read_bytes())
    content[-5] ^= 1
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match="another save"):
        moe_policy.load_file(saved)


def test_halves_of_two_saves_are_refused(saved, tmp_path):
    SINGLE.save(tmp_path / "snn")
    shutil.copy(tmp_path / "snn.safetensors", saved.with_suffix(".safetensors"))
    with pytest.raises(ModelFileError, match="another save"):
        moe_policy.load_file(saved)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"format": "other"}, "does not describe a model"),
        ({"version": 99}, "format version 99"),
        ({"kind": "pickle"}, "unknown kind"),
        ({"fingerprint": "0" * 16}, "train again"),
        ({"sizes": {"single": [2, 300, 75]}}, "do not fit together"),
        ({"mixing": {"softmax": -1}}, "do not fit together"),
        ({"sizes": None}, "do not fit together"),
    ],
)
def test_foreign_descriptions_are_refused(saved, change, match):
    path = saved.with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ModelFileError, match=match):
        moe_policy.load_file(saved)


def test_a_model_of_another_problem_is_refused(saved):
    heavier = PENDULUM.with_constants(mass=2.0)
    with pytest.raises(ModelFileError, match="train again"):
        moe_policy.load_file(saved, heavier)
    path = saved.with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"problem": "Nothing-v0"}))
    with pytest.raises(UnknownProblemError):
        moe_policy.load_file(saved)


def test_an_interrupted_save_leaves_the_old_model(saved, monkeypatch):
    before = {path: path.read_bytes() for path in saved.parent.iterdir()}
    monkeypatch.setattr(store.os, "replace", lambda *arguments: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        dataclasses.replace(MIXTURE, name="other").save(saved)
    assert {path: path.read_bytes() for path in saved.parent.iterdir()} == before


def test_shipped_models_are_found_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    MIXTURE.save(tmp_path / PENDULUM.id / "moe-custom")
    assert moe_policy.available(PENDULUM.id) == ["moe-custom", "optimal", "stabiliser"]
    assert moe_policy.load(PENDULUM.id, "moe-custom").parameters_total == MIXTURE.parameters_total
    with pytest.raises(UnknownModelError, match="did you mean 'moe-custom'"):
        moe_policy.load(PENDULUM.id, "moe-costum")
    with pytest.raises(UnknownProblemError, match="did you mean"):
        moe_policy.available("PendulumSwingup-v1")


@pytest.mark.parametrize("name", ["snn", "../../secret"])
def test_what_is_not_shipped_is_unknown(name, tmp_path, monkeypatch):
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    with pytest.raises(UnknownModelError, match="there are"):
        moe_policy.load(PENDULUM.id, name)
