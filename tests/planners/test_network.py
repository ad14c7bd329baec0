from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import moe_policy
from moe_policy.planners.networks import ARGMAX, Softmax
from moe_policy.planners.scaling import Standardizer

KINDS = ("single", "mixture", "soft", "nearest")


@settings(max_examples=30, deadline=None)
@given(kind=st.sampled_from(KINDS), rows=st.lists(st.tuples(st.floats(-10, 10), st.floats(-4, 4)), max_size=8))
def test_rows_do_not_depend_on_their_batch(planners, kind, rows):
    planner, p = planners[kind], np.array(rows).reshape(-1, 2)
    plan = planner(p)
    assert plan.states.shape == (len(p), 25, 2)
    assert plan.states.dtype == np.float64
    for i, row in enumerate(p):
        np.testing.assert_allclose(planner(row).flat()[0], plan.flat()[i], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_bad_parameters_are_named(planners, kind):
    with pytest.raises(ValueError, match="finite"):
        planners[kind]([np.nan, 0.0])
    with pytest.raises(ValueError, match=r"\(B, 2\)"):
        planners[kind](np.zeros((3, 4)))


def test_plans_of_a_mixture_are_those_of_the_chosen_experts(planners, samples_of_three_modes):
    mixture, p = planners["mixture"], samples_of_three_modes.parameters
    choice, probabilities = mixture.gate(p)
    np.testing.assert_array_equal(choice, probabilities.argmax(axis=1))
    np.testing.assert_allclose(probabilities.sum(axis=1), 1)
    experts = np.stack([plan.flat() for plan in mixture.experts(p)])
    np.testing.assert_allclose(mixture(p).flat(), experts[choice, np.arange(len(choice))], atol=1e-4)
    soft = dataclasses.replace(mixture, mixing=Softmax(1.0))(p).flat()
    np.testing.assert_allclose(soft, np.einsum("bk,kbr->br", probabilities, experts), atol=1e-4)
    assert mixture.mixing == ARGMAX


def test_every_expert_is_a_planner(planners, samples_of_three_modes):
    mixture, p = planners["mixture"], samples_of_three_modes.parameters
    for expert, plan in zip(mixture.expert_planners(), mixture.experts(p), strict=True):
        np.testing.assert_array_equal(expert(p).flat(), plan.flat())
    assert [expert.name for expert in mixture.expert_planners()] == [f"{mixture.name}, expert {i}" for i in range(3)]


def test_single_networks_have_no_gate(planners):
    single = planners["single"]
    for call in (lambda: single.gate([0, 0]), lambda: single.experts([0, 0]), single.expert_planners):
        with pytest.raises(TypeError, match="single network"):
            call()


def test_parameter_counts(planners):
    gate, expert = 3 * 50 + 51 * 3, 3 * 20 + 21 * 75
    single, mixture, soft = (planners[kind] for kind in ("single", "mixture", "soft"))
    assert single.parameters_total == single.parameters_active == single.network.count
    assert mixture.parameters_total == soft.parameters_active == gate + 3 * expert
    assert mixture.parameters_active == gate + expert


def test_networks_and_scalers_must_fit_the_problem(planners):
    with pytest.raises(ValueError, match="expected networks and scalers from 2 to 75 values"):
        dataclasses.replace(planners["single"], inputs=Standardizer(np.zeros(3), np.ones(3)))


def test_how_a_planner_was_made_is_saved(planners, samples_of_three_modes, tmp_path):
    mixture = planners["mixture"]
    mixture.save(tmp_path / "moe")
    loaded = moe_policy.load_file(tmp_path / "moe", kind=moe_policy.NetworkPlanner)
    assert loaded.details == json.loads(json.dumps(mixture.details))
    assert loaded.details["clusters"]["sizes"] == np.bincount(samples_of_three_modes.mode).tolist()
    assert loaded.report is None
