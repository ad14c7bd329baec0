"""One value for each problem: its parts agree, and a problem of the user has a usable one."""

import dataclasses

import pytest

import ocp_envs
from moe_policy.experiments.benchmark import BENCHMARKS, benchmark_of
from moe_policy.experiments.benchmark.parts import Planners
from moe_policy.experiments.benchmark.published import Published
from moe_policy.learning import recipes
from ocp_envs.problems import BENCHMARK
from ocp_envs.sets.splits import sets_of
from tests.small_problems import DOUBLE_INTEGRATOR


def test_every_problem_has_a_benchmark():
    assert list(BENCHMARKS) == [problem.id for problem in BENCHMARK]
    assert len({benchmark.short for benchmark in BENCHMARKS.values()}) == len(BENCHMARKS)


@pytest.mark.parametrize("env_id", BENCHMARKS)
def test_benchmarks_name_what_exists(env_id):
    problem, benchmark = ocp_envs.load(env_id), BENCHMARKS[env_id]
    for name in benchmark.planners.trained:
        with pytest.raises(TypeError, match="expected Samples or SampleSource"):
            recipes.make(name, object())
    assert all(size < len(sets_of(problem).training) for size in benchmark.training.sizes)
    assert set(benchmark.training.whole) <= set(benchmark.planners.trained)
    assert set(benchmark.learners.short) <= set(benchmark.learners.settings)
    assert all(settings.algorithm == name for name, settings in benchmark.learners.settings.items())
    assert benchmark.overview.learner in {None, *benchmark.learners.settings}
    assert benchmark.overview.kmeans in {None, *benchmark.planners.compared}
    assert set(benchmark.planners.compared) <= set(benchmark.shipped)
    assert benchmark.quick.training <= len(sets_of(problem).training)
    assert benchmark.quick.validation <= len(sets_of(problem).validation)
    if benchmark.figures.around is not None:
        problem.check_parameters([benchmark.figures.around])


def test_a_benchmark_uses_only_planners_that_it_trains():
    benchmark = benchmark_of(DOUBLE_INTEGRATOR)
    with pytest.raises(ValueError, match="'moe-kmeans-7'"):
        dataclasses.replace(benchmark, planners=Planners(compared=("snn", "moe-kmeans-7")))


def test_planners_are_shipped_that_are_compared_or_have_a_published_error():
    planners = Planners(compared=("snn",), trained=("snn", "moe-custom", "moe-random"))
    published = {"moe-custom": Published(validation_error=0.1), "moe-random": Published(success=3)}
    benchmark = dataclasses.replace(benchmark_of(DOUBLE_INTEGRATOR), planners=planners, published=published)
    assert benchmark.shipped == ("snn", "moe-custom")


def test_a_problem_of_the_user_has_a_benchmark():
    benchmark = benchmark_of(DOUBLE_INTEGRATOR)
    assert benchmark.shipped == ("snn", "moe-custom")
    assert {perturbation.name for perturbation in benchmark.perturbations} >= {"noise", "delay"}
    assert (benchmark.figures.around, benchmark.figures.rise, benchmark.overview.learner) == (None, None, None)


def test_fewer_training_instances_get_more_epochs():
    training = benchmark_of(ocp_envs.load("GroundVehicle-v0")).training
    assert [training.settings_of(count).epochs for count in (100, 3_000, 36_600)] == [100, 640, 200]
