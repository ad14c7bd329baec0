from functools import partial

import numpy as np
import pytest

from moe_policy.learning.settings import TrainingSettings
from moe_policy.rollouts import comparison
from moe_policy.rollouts.comparison import compare, fewest
from ocp_envs.data import many
from ocp_envs.data.many import solve_many
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers import improvement
from ocp_envs.support.sharing import Loans
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, TURNING

QUICK = {"settings": TrainingSettings(epochs=60), "development": 20, "test": 30}


@pytest.fixture(scope="module")
def _solves_here(interpreted):
    loans = Loans(partial(Solver, TURNING), 1)
    with pytest.MonkeyPatch.context() as patch:
        for module in (many, comparison, improvement):
            patch.setattr(module, "lent_solvers", lambda problem: loans)
        yield


@pytest.fixture(scope="module")
def optima(_solves_here):
    return solve_many(TURNING, sample(TURNING, 0, 80), starts=1)


@pytest.fixture(scope="module")
def compared(optima):
    return compare(TURNING, optima, clusters=(2, 3), **QUICK)


def test_all_planners_are_compared_with_the_tracked_optimum(compared):
    names = list(compared.planners)
    assert names[:4] == ["optimal", "nearest", "snn", "moe-custom"]
    assert [name for name in names if "kmeans" in name] == [name for name in compared.development if name in names[4:]]
    assert list(compared.metrics) == names
    assert compared.metrics["optimal"].success.fraction == 1
    assert compared.metrics["optimal"].relative_cost == 1
    assert {name for name in names if name.endswith("one solve")} == {"snn, one solve", f"{compared.best}, one solve"}
    assert compared.metrics[f"{compared.best}, one solve"].success.fraction == 1


def test_the_best_planner_is_chosen_on_development_instances_alone(compared):
    kept = {name: count for name, count in compared.development.items() if name in compared.planners}
    assert kept[compared.best] == max(kept.values())
    assert set(compared.development) >= {"snn", "moe-custom", "moe-kmeans-2"}
    assert compared.sizes == (80, 20, 30)


def test_the_table_is_what_is_printed(compared):
    first, *lines = str(compared).splitlines()
    assert first.startswith("| planner ")
    assert "success at the plan's end | … after terminal regulation | cost / optimal | left the box |" in first
    assert lines[1].startswith("| optimal ")
    assert "30 of 30" in lines[1]
    assert "1.000 (30)" in lines[1]
    assert f"{compared.best} is the best of the trained ones on 20 development instances" in lines[-1]


@pytest.mark.usefixtures("_solves_here")
def test_instances_to_learn_from_are_not_those_that_are_tested():
    seen = solve_many(TURNING, sample(TURNING, comparison._TEST, 20), starts=1)
    with pytest.raises(ValueError, match="Turn-v0: instances of this seed are among the samples"):
        compare(TURNING, seen, **QUICK)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"clusters": [1]}, "each of clusters: expected a whole number in 2 … 80, got 1"),
        ({"test": 0}, "test: expected a whole number in 1 … 1000000, got 0"),
        ({"problem": DOUBLE_INTEGRATOR}, "the database belongs to Turn-v0, not to DoubleIntegrator-v0"),
    ],
)
def test_what_does_not_fit_is_refused(optima, change, message):
    with pytest.raises(ValueError, match=message):
        compare(**{"problem": TURNING, "database": optima, **QUICK, **change})


def test_the_fewest_clusters_win_that_are_as_good_as_the_best():
    k, (low, high) = fewest({2: 80, 4: 96, 8: 99}, 100)
    assert k == 4
    assert low < 96 < 99 < high <= 100
    assert fewest({4: 10, 2: 10}, 10)[0] == 2


def test_numbers_of_clusters_that_are_too_small_are_left_out(optima):
    samples = optima.samples()
    names = [name for name, _ in comparison._partitions(samples, (2, 40), 0)]
    assert names == ["moe-custom", "moe-kmeans-2"]
    assert comparison._partitions(samples[np.flatnonzero(samples.mode == 0)], (), 0) == []
