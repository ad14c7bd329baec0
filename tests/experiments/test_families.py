"""Records and figures of families that are found, from made-up continuations."""

import dataclasses

import numpy as np
import pytest

from moe_policy.experiments.families import FAMILY_COLUMNS, Families, Gaps, families
from moe_policy.experiments.figures.families import families_figure
from moe_policy.learning.families import families_of
from moe_policy.reports.tables import markdown_table
from ocp_envs.data.beyond import Beyond
from ocp_envs.data.continuation import Continuation
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.support.provenance import provenance
from tests.synthetic import fake_samples

SAMPLES = fake_samples(count=300, modes=3)
BOX = SAMPLES.problem.parameters


def continuing(apart):
    """All neighbours continue into each other but those ``apart``, (E,)."""
    pairs = neighbour_pairs(BOX, SAMPLES.parameters, 8)
    distance = np.repeat(np.where(apart(pairs), 2.0, 1e-5)[:, None], 2, axis=1).astype(np.float32)
    iterations = np.full(distance.shape, 7, dtype=np.int32)
    return Continuation(pairs, distance, np.zeros_like(distance), iterations)


def of_different_modes(pairs):
    return SAMPLES.mode[pairs[:, 0]] != SAMPLES.mode[pairs[:, 1]]


def record_of(continuation):
    parts = families_of(SAMPLES, continuation)
    return families(
        SAMPLES, continuation, parts, training_key="k", seconds=None, workers=2, provenance=provenance()
    ), parts


def test_families_that_are_the_declared_ones_have_the_index_one():
    continuation = continuing(of_different_modes)
    record, _ = record_of(continuation)
    assert (record.k, record.adjusted_rand_index) == (3, 1.0)
    assert sorted(row.mainly for row in record.rows) == sorted(SAMPLES.problem.modes.names)
    assert [row.others for row in record.rows] == [0, 0, 0]
    assert (record.joined_across, record.apart_within, record.one_way, record.not_optimal) == (0, 0, 0, 0)
    assert record.not_joined == of_different_modes(continuation.pairs).sum()
    assert (record.solves, record.iterations) == (2 * record.pairs, 14 * record.pairs)
    assert record.distance_joined < 1e-2 < record.distance_apart
    assert Families.from_json(record.to_json()) == record
    assert record.refined_index == 1.0
    assert "| 1.0000 |" in markdown_table([record], FAMILY_COLUMNS)


def test_a_family_that_is_split_further_is_told_apart_from_a_wrong_one():
    """Half of the first mode by the speed, the others whole."""
    upper = (SAMPLES.mode == 0) & (SAMPLES.parameters[:, 1] > 0)
    part = np.where(upper, 3, SAMPLES.mode)
    record, _ = record_of(continuing(lambda pairs: part[pairs[:, 0]] != part[pairs[:, 1]]))
    assert record.k == 4
    assert record.adjusted_rand_index < 0.95
    assert record.refined_index == 1.0


def test_instances_of_two_declared_families_in_one_that_was_found_are_counted():
    merged = continuing(lambda pairs: (SAMPLES.mode[pairs] == 2).sum(axis=1) == 1)
    record, _ = record_of(merged)
    assert record.k == 2
    assert record.rows[0].others == min(np.bincount(SAMPLES.mode)[:2])
    assert record.adjusted_rand_index < 0.9
    assert record.joined_across > 0


def test_where_nothing_disagrees_there_is_one_family_and_no_smallest_distance():
    record, _ = record_of(continuing(lambda pairs: np.zeros(len(pairs), bool)))
    assert (record.k, record.not_joined, record.distance_apart) == (1, 0, None)
    assert "Rand" not in markdown_table([record], FAMILY_COLUMNS)


def test_instances_at_which_a_neighbour_leads_to_a_lower_cost_are_counted_once():
    continuation = continuing(of_different_modes)
    excess = continuation.excess.copy()
    excess[[0, 1], 1] = -0.1  # at the first sample of both pairs, from the second
    record, _ = record_of(dataclasses.replace(continuation, excess=excess))
    assert len(np.unique(continuation.pairs[:2, 0])) == record.not_optimal == 1


def test_gaps_count_where_a_second_family_is_known():
    cost = np.full((300, 2), [1.0, np.inf])
    cost[:7, 1] = 1.2
    declared = np.full((300, 3), np.inf)
    declared[:, 0], declared[:9, 2], declared[:4, 1] = 1.0, 1.5, 1.25
    found = Beyond(np.ones(300), cost, np.arange(8), np.ones(8, int), SAMPLES.trajectory[:8], 20)
    gaps = Gaps.of(dataclasses.replace(SAMPLES, mode_costs=declared), found, 0.3, 1.5)
    assert gaps == Gaps(margin=0.3, further=8, instances=7, declared=4, solves=20, seconds=1.5)


@pytest.mark.parametrize("known", [True, False])
def test_the_figure_shows_families_and_where_their_costs_are_known_the_gap(drawn, known):
    _, parts = record_of(continuing(of_different_modes))
    costs = np.linspace(1, 2, 900).reshape(300, 3) if known else None
    figure = drawn(families_figure, SAMPLES, parts, costs)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert len(panels) == (2 if known else 1)
    assert panels[0].get_xlabel() == "theta, rad"
    assert len(panels[0].get_legend().get_texts()) == 3
