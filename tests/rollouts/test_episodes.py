"""Batches of episodes."""

import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from moe_policy.rollouts.episodes import Episodes
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problems.vehicle import VEHICLE
from tests.closed_loop import PARAMETERS, constant, vector
from tests.small_problems import DOUBLE_INTEGRATOR


def some_episodes(horizon, record=True):
    return rollout(vector(DOUBLE_INTEGRATOR, 3), constant(0.5), PARAMETERS, horizon=horizon, record=record)


def test_records_of_different_lengths_are_padded_with_nan():
    short, long = some_episodes(0.1), some_episodes(0.2)
    joined = Episodes.concatenate([short, long[1:]])
    assert joined.states.shape == (5, 11, 2)
    assert joined.controls.shape == (5, 10, 1)
    np.testing.assert_array_equal(joined.states[:3, :6], short.states)
    assert np.isnan(joined.states[:3, 6:]).all()
    np.testing.assert_array_equal(joined.states[3:], long.states[1:])


def test_episodes_without_records_stay_without():
    joined = Episodes.concatenate([some_episodes(0.1, record=False)] * 2)
    assert (len(joined), joined.states, joined.controls) == (6, None, None)


def test_a_selection_keeps_all_fields_of_its_rows():
    whole = some_episodes(0.1)
    whole = replace(whole, cost=np.arange(3.0))
    for chosen in (whole[1:], whole[np.array([False, True, True])], whole[np.array([1, 2])]):
        for field in fields(Episodes):
            np.testing.assert_array_equal(getattr(chosen, field.name), getattr(whole, field.name)[1:])


def test_a_frame_has_a_column_for_each_result_and_each_parameter():
    pytest.importorskip("pandas")
    episodes = some_episodes(0.1)
    frame = episodes.to_frame(DOUBLE_INTEGRATOR)
    assert list(frame.columns[:2]) == ["x", "v"]
    assert {"success", "cost", "violation", "final_error"} <= set(frame.columns)
    assert "states" not in frame.columns
    np.testing.assert_array_equal(frame[["x", "v"]], PARAMETERS)
    np.testing.assert_array_equal(frame["cost"], episodes.cost)


def test_a_frame_without_pandas_is_an_error_with_its_cure(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="to_frame needs pandas: pip install pandas"):
        some_episodes(0.1).to_frame(DOUBLE_INTEGRATOR)


def test_a_frame_of_another_problem_is_refused():
    pytest.importorskip("pandas")
    with pytest.raises(ValueError, match=r"expected the parameters .*, got episodes with 2 parameters"):
        some_episodes(0.1).to_frame(VEHICLE)
