"""Benchmarks of speed: how what was measured is compared, and how accurate a control step is."""

import numpy as np
import pytest

from moe_policy.experiments.generation import Totals
from moe_policy.experiments.speed import environments, generation, scaling, solver
from moe_policy.reports.records import ABSENT
from ocp_envs.data.settings import DEFAULT_GENERATION
from ocp_envs.problems.pendulum import PENDULUM


def rate(per_second):
    return solver.Rate(
        verified=1,
        seconds=1.0,
        verified_per_second=per_second,
        iterations_median=1.0,
        milliseconds_median=1.0,
        statuses={},
        cost_sum=0.0,
    )


def comparison(ours, opti, expanded, **more):
    return solver.Comparison(
        ours=rate(ours),
        opti=rate(opti),
        opti_expanded=rate(expanded),
        ratio_to_the_better=ours / max(opti, expanded),
        **more,
    )


def test_the_plain_ratio_sets_our_best_guess_against_opti_without_a_warm_start():
    compared = {
        "line": comparison(10.0, 4.0, 5.0),
        "warm": comparison(30.0, 20.0, 8.0),
    }
    assert solver.plain_ratio(compared) == 6.0
    assert solver.plain_ratio({"warm": compared["warm"]}) is ABSENT
    assert solver.plain_ratio(compared, "riccati") is ABSENT
    both = {"line": comparison(10.0, 4.0, 5.0, riccati=rate(50.0), riccati_ratio=10.0)}
    assert solver.plain_ratio(both, "riccati") == 10.0


def test_a_comparison_tells_the_rates_of_the_solvers_that_were_measured():
    assert comparison(10.0, 4.0, 5.0).text("line").splitlines()[-1] == "line  ratio to the better Opti: 2.0"
    text = comparison(10.0, 4.0, 5.0, riccati=rate(50.0), riccati_ratio=10.0).text("line")
    assert "riccati" in text
    assert text.splitlines()[-1] == "line  ratio to the better Opti: 2.0, 10.0"


def test_settings_differ_from_the_default_in_what_their_name_says():
    settings = generation.settings_by_name()
    assert settings["default"] == DEFAULT_GENERATION
    assert settings["thorough"] == generation.THOROUGH
    both = settings["neighbours 1, margin 0.1"]
    assert (both.neighbours, both.margin, both.starts) == (1, 0.1, DEFAULT_GENERATION.starts)


def test_an_optimum_counts_as_missed_above_the_lowest_cost_of_all():
    def run(seconds, *costs):
        totals = Totals(problems=3, solved=3, solves=6, failures=0, fallbacks=0, iterations=60)
        return generation.Run(settings={}, seconds=seconds, totals=totals, cost=np.array(costs))

    rows = generation.compare({"default": run(2.0, 1.0, 2.0, np.inf), "other": run(1.0, 1.0005, 1.9, 3.0)})
    assert (rows["default"].missed, rows["other"].missed) == (2, 0)
    assert (rows["default"].rate_to_default, rows["other"].rate_to_default) == (1.0, 2.0)
    assert rows["other"].solves_per_problem == 2.0


def test_more_runge_kutta_steps_are_more_accurate():
    errors = [environments.step_error(PENDULUM, substeps, 1.0) for substeps in (1, 2)]
    assert errors[1].largest < errors[0].largest / 8  # of fourth order
    assert errors[0].median < errors[0].percent_99 < errors[0].largest
    middle = environments.step_error(PENDULUM, 1, 0.5)
    assert middle.largest < errors[0].largest


@pytest.mark.parametrize("problem", [PENDULUM], ids=lambda problem: problem.id)
def test_the_steps_of_the_environment_are_marked(problem):
    rows = environments.substeps_of(problem, num_envs=4, repetitions=1)
    assert [row.substeps for row in rows] == [1, 2, 3, 4]
    assert sum(row.chosen for row in rows) == 1
    assert all(row.steps_per_second > 0 for row in rows)


def test_the_time_of_a_call_and_that_of_a_row_are_told_apart():
    assert scaling.line_through({n: 3e-5 + 2e-7 * n for n in (1, 64, 4096)}) == pytest.approx((3e-5, 2e-7))
    assert scaling.line_through({n: 1e-3 * n for n in (1, 4)}) == pytest.approx((0.0, 1e-3))
    assert scaling.line_through({4: 2.0}) == (0.0, 0.5)
