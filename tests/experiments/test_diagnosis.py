"""Mixtures that are wrong on purpose: the cause of each failure is known before it is looked for.

A mass with |u| ≤ 1 starts at rest, at −4 m or at 1 m. From a distance d it needs 2√d seconds to the origin, and the
plans here take a tenth more: 4.4 s from the left, 2.2 s from the right. So from the left a plan of 2.2 s fails whatever
the tracking does, and so does any that takes less than 3.9 s. Networks of biases alone plan for one side each.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import moe_policy.experiments.diagnosis
import ocp_envs
from moe_policy.experiments.diagnosis import explain
from moe_policy.experiments.failures import Cause, EvaluatedAt, counts
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX, MixtureOfExperts, SingleNetwork, Softmax
from moe_policy.planners.scaling import Standardizer
from ocp_envs import problems
from ocp_envs.data.database import Database
from ocp_envs.data.layout import StoredRows
from ocp_envs.data.samples import Samples
from ocp_envs.goal import Modes
from ocp_envs.solvers.nlp import Status
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, rest_to_rest, with_states

LEFT, RIGHT = 0, 1


def sides(problem, parameters, trajectory, multipliers):
    return (trajectory.states[:, 0, 0] > 0).astype(np.int64)


#: Success is judged at the plan's end.
PROBLEM = dataclasses.replace(DOUBLE_INTEGRATOR, id="TwoSides-v0", hold=0.0, modes=Modes(("left", "right"), sides))
#: Success is judged after ten seconds of hold.
HELD = dataclasses.replace(PROBLEM, id="TwoSidesHeld-v0", hold=10.0, time_limit=30.0)


def plans(starts, offset=0.0):
    """Exact plans from rest at ``starts`` to the origin, moved by ``offset``."""
    each = [rest_to_rest(np.array([x]), 2.2 * np.sqrt(abs(x)), PROBLEM.knots) for x in starts]
    states, controls, duration = (np.concatenate(parts) for parts in zip(*each))
    return Trajectory(states + np.array([offset, 0.0]), controls, duration)


def samples(starts, mode=None, trajectory=None, problem=PROBLEM, costs=(1.0, 1.5)):
    starts = np.asarray(starts, dtype=np.float64)
    mode = (starts > 0).astype(np.int64) if mode is None else np.asarray(mode)
    mode_costs = np.where(mode[:, None] == np.arange(2), *costs)
    return Samples(
        problem=problem,
        parameters=np.stack([starts, np.zeros_like(starts)], axis=1),
        trajectory=plans(starts) if trajectory is None else trajectory,
        cost=mode_costs.min(axis=1),
        mode=mode,
        multipliers=np.zeros((len(starts), problem.knots, 0)),
        mode_costs=mode_costs,
        index=10 * np.arange(len(starts)),
    )


def biased(values):
    """A network that answers ``values`` to everything."""
    return SingleNetwork((np.zeros((len(values), 2)),), (values,))


def by_side(certainty=20.0):
    """A gate whose logits are ∓ x, so that it prefers the expert of the side."""
    return SingleNetwork((np.array([[-certainty, 0.0], [certainty, 0.0]]),), (np.zeros(2),))


def mixture(gate, experts, clusters=(LEFT, RIGHT), problem=PROBLEM, mixing=ARGMAX, details=None):
    """A mixture whose experts plan the given trajectories; ``clusters``: the mode of each, or ``None``."""
    network = MixtureOfExperts(gate, [biased(plan.flat()[0]) for plan in experts])
    if details is None:
        method = {"method": "kmeans"} if clusters is None else {"method": "custom", "settings": {"modes": [*clusters]}}
        details = {"clusters": method}
    scalers = (Standardizer(np.zeros(n), np.ones(n)) for n in (2, problem.flat_size))
    return NetworkPlanner(problem, "made wrong", network, *scalers, mixing=mixing, details=details)


GOOD = (plans([-4.0]), plans([1.0]))
CASES = samples([-4.0, 1.0, -3.98])
TRAINING = samples([-3.99, 0.99])


def causes(failures):
    return {failure.index: failure.cause for failure in failures}


# -- causes ------------------------------------------------------------------------------------------------------------


def test_a_mixture_that_does_not_fail_has_nothing_to_explain():
    assert explain(PROBLEM, mixture(by_side(), GOOD), CASES, TRAINING) == []


def test_a_gate_that_always_goes_right_is_to_blame_on_the_left():
    failures = explain(PROBLEM, mixture(biased([0.0, 3.0]), GOOD), CASES, TRAINING)
    assert causes(failures) == {0: Cause.GATE, 20: Cause.GATE}
    for failure in failures:
        assert (failure.mode, failure.right, failure.chosen, failure.successful) == ("left", (LEFT,), RIGHT, (LEFT,))
        assert failure.confidence == pytest.approx(1 / (1 + np.exp(-3.0)))
        assert failure.predicted_error == pytest.approx(0.0, abs=1e-6)  # the plan ends well, from the wrong side
        assert failure.final_error > PROBLEM.goal.radius
        assert failure.relative_gap == pytest.approx(0.5)


def test_an_expert_that_ends_beside_the_goal_is_to_blame():
    planner = mixture(by_side(), (plans([-4.0], offset=0.5), GOOD[1]))
    failures = explain(PROBLEM, planner, CASES, TRAINING)
    assert causes(failures) == {0: Cause.EXPERT, 20: Cause.EXPERT}
    first = failures[0]
    assert (first.chosen, first.successful, first.parameters) == (LEFT, (), (-4.0, 0.0))
    assert first.predicted_error == pytest.approx(0.5, abs=1e-6)
    assert first.final_error == pytest.approx(0.5, abs=0.05)
    # 0.01 m in a box of 10 m.
    assert [failure.nearest_distance for failure in failures] == pytest.approx([1e-3, 1e-3])


def test_an_optimum_that_cannot_be_tracked_is_the_trackers_whatever_else_is_wrong():
    wrong = samples(CASES.parameters[:, 0], trajectory=plans([-4.0, 1.0, -3.98], offset=0.5))
    failures = explain(PROBLEM, mixture(biased([0.0, 3.0]), GOOD), wrong, TRAINING)
    assert causes(failures) == {0: Cause.TRACKER, 20: Cause.TRACKER}
    assert failures[0].successful == (LEFT,)


def test_without_a_sample_to_follow_nearby_the_data_are_to_blame():
    """The only samples of the mode start so near to the origin that they are over too soon."""
    planner = mixture(by_side(), (plans([-4.0], offset=0.5), GOOD[1]))
    far = samples([-1.0, -2.0, 0.99])
    failures = explain(PROBLEM, planner, CASES, far)
    assert causes(failures) == {0: Cause.DATA, 20: Cause.DATA}
    assert failures[0].nearest_distance == pytest.approx(0.2)
    # One near sample among the nearest is enough, whether or not it is the first.
    for following in ([-1.0, -3.9], [-4.0, -1.0]):
        near = samples([-4.0, -3.9], trajectory=plans(following))
        assert causes(explain(PROBLEM, planner, CASES[:1], near)) == {0: Cause.EXPERT}
    near = samples([-4.0, -3.9], trajectory=plans([-1.0, -3.9]))
    assert causes(explain(PROBLEM, planner, CASES[:1], near, neighbours=1)) == {0: Cause.DATA}


def test_a_mode_without_any_sample_or_expert_is_a_lack_of_data():
    planner = mixture(by_side(), (plans([-4.0], offset=0.5), GOOD[1]))
    failures = explain(PROBLEM, planner, CASES, samples([0.99]))
    assert causes(failures) == {0: Cause.DATA, 20: Cause.DATA}
    assert failures[0].nearest_distance is None
    # Here samples of the mode are near, but the mixture learnt from others.
    alone = mixture(biased([0.0]), (GOOD[1],), clusters=(RIGHT,))
    failures = explain(PROBLEM, alone, CASES, TRAINING)
    assert causes(failures) == {0: Cause.DATA, 20: Cause.DATA}
    assert failures[0].right == ()


def test_where_clusters_are_not_modes_any_expert_may_be_right():
    wrong, spare = plans([-4.0], offset=0.5), GOOD[0]
    gate = SingleNetwork((np.array([[-20.0, 0.0], [20.0, 0.0], [0.0, 0.0]]),), (np.zeros(3),))
    experts = (wrong, GOOD[1], spare)
    kmeans = explain(PROBLEM, mixture(gate, experts, clusters=None), CASES, TRAINING)
    assert causes(kmeans) == {0: Cause.GATE, 20: Cause.GATE}
    assert (kmeans[0].right, kmeans[0].successful) == ((0, 1, 2), (2,))
    # The same weights over modes: the third expert is not that of the mode, and the gate chose well.
    three = dataclasses.replace(PROBLEM, modes=Modes(("left", "right", "spare"), sides))
    custom = explain(three, mixture(gate, experts, (0, 1, 2)), CASES, TRAINING)
    assert causes(custom) == {0: Cause.EXPERT, 20: Cause.EXPERT}
    assert custom[0].successful == (2,)


def test_experts_belong_to_the_modes_the_clusters_name_not_to_their_own_numbers():
    planner = mixture(biased([3.0, 0.0]), GOOD[::-1], clusters=(RIGHT, LEFT))
    failures = explain(PROBLEM, planner, CASES, TRAINING)
    assert causes(failures) == {0: Cause.GATE, 20: Cause.GATE}
    assert (failures[0].right, failures[0].chosen) == ((1,), 0)


def test_retrained_mixtures_keep_the_clusters_they_began_with():
    clusters = {"clusters": {"method": "custom", "settings": {"modes": [LEFT, RIGHT]}}}
    planner = mixture(biased([0.0, 3.0]), GOOD, details={"pretraining": clusters})
    assert explain(PROBLEM, planner, CASES, TRAINING)[0].right == (LEFT,)


def test_a_blend_of_good_experts_is_the_gates_fault():
    """Softmax of nearly equal logits plans for 3.3 s, too short for the left, though argmax would have chosen well."""
    planner = mixture(by_side(certainty=0.01), GOOD, mixing=Softmax(1.0))
    failures = explain(PROBLEM, planner, CASES[::2], TRAINING)
    assert causes(failures) == {0: Cause.GATE, 20: Cause.GATE}
    assert (failures[0].chosen, failures[0].successful) == (LEFT, (LEFT,))
    assert explain(PROBLEM, dataclasses.replace(planner, mixing=ARGMAX), CASES, TRAINING) == []


# -- evaluation, records, refusals -------------------------------------------------------------------------------------


def test_a_plan_that_the_hold_repairs_fails_at_its_end_only():
    planner = mixture(by_side(), (plans([-4.0], offset=0.5), GOOD[1]), problem=HELD)
    cases, training = (dataclasses.replace(each, problem=HELD) for each in (CASES, TRAINING))
    assert explain(HELD, planner, cases, training) == []
    at_end = explain(HELD, planner, cases, training, at="plan-end")
    assert causes(at_end) == {0: Cause.EXPERT, 20: Cause.EXPERT}
    assert at_end[0].final_error == pytest.approx(0.5, abs=0.05)


def test_records_are_json_and_all_causes_are_counted():
    bad = with_states(plans([-4.0]), (0, 3, 0), np.nan)
    failures = explain(PROBLEM, mixture(by_side(), (bad, GOOD[1])), samples([-4.0, 1.0], costs=(1.0, np.inf)), TRAINING)
    (record,) = [failure.to_json() for failure in failures]
    assert json.loads(json.dumps(record, allow_nan=False))["cause"] == "expert"
    assert (record["relative_gap"], record["rejected"]) == (None, True)
    assert counts(failures) == {"tracker": 0, "gate": 0, "data": 0, "expert": 1}


def test_the_chosen_expert_fails_where_the_mixture_does(monkeypatch):
    """On the edge of the ball rounding decides; the same plan cannot both fail and succeed."""
    planner = mixture(by_side(), (plans([-4.0], offset=1.5 * PROBLEM.goal.radius), GOOD[1]))
    success, calls = moe_policy.experiments.diagnosis._Trial.success, []

    def rounded(self, episodes):
        calls.append(len(episodes))
        return success(self, episodes) | (len(calls) == 2)

    monkeypatch.setattr(moe_policy.experiments.diagnosis._Trial, "success", rounded)
    failures = explain(PROBLEM, planner, CASES, TRAINING)
    assert calls[:2] == [3, 2]
    assert causes(failures) == {0: Cause.EXPERT, 20: Cause.EXPERT}


def test_unusable_arguments_are_named():
    good = mixture(by_side(), GOOD)
    single = dataclasses.replace(good, name="snn", network=biased(GOOD[0].flat()[0]))
    with pytest.raises(TypeError, match=r"expected a mixture of experts.*'snn'"):
        explain(PROBLEM, single, CASES, TRAINING)
    with pytest.raises(TypeError, match=r"expected a mixture of experts.*'function'"):
        explain(PROBLEM, plans, CASES, TRAINING)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"training samples made for DoubleIntegrator-v0 .* expected TwoSides-v0"):
        explain(PROBLEM, good, CASES, dataclasses.replace(TRAINING, problem=DOUBLE_INTEGRATOR))
    with pytest.raises(ValueError, match="at least one case and one neighbour, got 0 and 3"):
        explain(PROBLEM, good, CASES[:0], TRAINING)
    with pytest.raises(ValueError, match="is not a valid EvaluatedAt"):
        explain(PROBLEM, good, CASES, TRAINING, at="tomorrow")


# -- the script --------------------------------------------------------------------------------------------------------


def store(path, held):
    """A database that holds ``held`` and one unsolved problem at its end."""
    size, slots = len(held) + 1, np.arange(len(held))
    database = Database.create(path, PROBLEM, np.concatenate([held.parameters, [[0.0, 1.0]]]))
    cost, z = np.full((size, 2), np.inf), np.full((size, 2, PROBLEM.flat_size), np.nan)
    cost[slots, held.mode], z[slots, held.mode] = held.cost, held.trajectory.flat()
    slot_status = np.where(np.isfinite(cost), Status.SOLVED, Status.EMPTY).astype(np.int8)
    status = np.where(np.arange(size) < len(held), Status.SOLVED, Status.EMPTY).astype(np.int8)
    none = np.zeros(size, np.int32)
    multipliers = np.zeros((size, 2, PROBLEM.knots, 0))
    database.write(0, StoredRows(status, slot_status, cost, z, multipliers, none, none, none, none))


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Runs the script on databases and models of the test's own; what it wrote."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    monkeypatch.delitem(sys.modules, "explain_failures", raising=False)
    module = importlib.import_module("explain_failures")
    monkeypatch.setattr(ocp_envs, "load", lambda name: {PROBLEM.id: PROBLEM}.get(name) or problems.load(name))
    (tmp_path / "data" / PROBLEM.id).mkdir(parents=True)
    for name, held in (("training", TRAINING), ("validation", CASES)):
        store(tmp_path / "data" / PROBLEM.id / f"{name}.zarr", held)

    def call(*arguments):
        folders = [f"--{name}={tmp_path / name}" for name in ("data", "models", "results")]
        monkeypatch.setattr(sys, "argv", ["explain_failures", "--env", PROBLEM.id, *folders, *map(str, arguments)])
        module.main()
        (written,) = (tmp_path / "results").iterdir()
        record = json.loads(written.read_text())
        written.unlink()
        return written.name, record

    return call


def test_script_lists_failures_of_a_named_model_and_of_a_file(run, tmp_path, capsys):
    planner = mixture(biased([0.0, 3.0]), GOOD)
    planner.save(tmp_path / "models" / PROBLEM.id / "moe-custom")
    planner.save(tmp_path / "other" / "moe-0.1")
    name, record = run("--planner", "moe-custom")
    assert name == "failures_TwoSides-v0_moe-custom.json"
    assert record["causes"] == {"tracker": 0, "gate": 2, "data": 0, "expert": 0}
    assert [failure["index"] for failure in record["failures"]] == [0, 2]
    assert (record["cases"], record["unsolved"], record["success"]["count"]) == (3, 1, 1)
    assert record["provenance"]["versions"]["ocp-moe"]
    assert str(tmp_path) not in json.dumps(record)
    shown = capsys.readouterr().out
    assert "gate            2" in shown
    assert "1 (6.1–79.2 %) of 3 cases succeed" in shown
    for suffix in ("", ".json", ".safetensors"):
        name, again = run("--planner", tmp_path / "other" / f"moe-0.1{suffix}", "--at", EvaluatedAt.PLAN_END)
        assert name == "failures_TwoSides-v0_moe-0.1_plan-end.json"
        assert again["failures"] == record["failures"]
    name, first = run("--planner", "moe-custom", "--cases", 2)
    assert (first["cases"], first["causes"]["gate"]) == (2, 1)


def test_script_writes_a_record_without_failures_too(run, tmp_path):
    mixture(by_side(), GOOD).save(tmp_path / "models" / PROBLEM.id / "moe-custom")
    _, record = run()
    assert record["failures"] == []
    assert record["success"]["count"] == 3
