import numpy as np
import pytest

import moe_policy
from moe_policy.checking.candidates import Candidates
from moe_policy.planners.margin import Margin
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.sets.sampling import sample

P = sample(PENDULUM, 3, 40)


@pytest.fixture(scope="module")
def mixture():
    return moe_policy.load(PENDULUM, "moe-custom")


@pytest.fixture(scope="module")
def round_the_sphere():
    return moe_policy.load(QUADCOPTER_OBSTACLE, "moe-custom")


@pytest.mark.parametrize("experts", [1, 2, 3])
def test_the_likeliest_experts_come_first(mixture, experts):
    candidates = Candidates(mixture, experts)
    sources, plans = candidates(P)
    chosen, probability = mixture.gate(P)
    assert candidates.count == experts == len(plans)
    np.testing.assert_array_equal(sources[:, 0], chosen)
    ranked = np.take_along_axis(probability, sources, axis=1)
    assert (np.diff(ranked, axis=1) <= 0).all()
    np.testing.assert_allclose(plans[0].flat(), mixture(P).flat(), atol=1e-5)
    for column, plan in zip(sources.T, plans):
        every = [expert.flat() for expert in mixture.experts(P)]
        expected = np.array([every[source][row] for row, source in enumerate(column)])
        np.testing.assert_allclose(plan.flat(), expected, atol=1e-5)


def test_there_are_not_more_experts_than_the_mixture_has(mixture):
    assert Candidates(mixture, 100).count == len(mixture.expert_planners())


def test_other_planners_have_one_plan(mixture):
    single = moe_policy.load(PENDULUM, "snn")
    sources, plans = Candidates(single)(P)
    assert sources.tolist() == [[0]] * len(P)
    np.testing.assert_array_equal(plans[0].flat(), single(P).flat())
    assert Candidates(lambda p: single(p), problem=PENDULUM).count == 1
    assert len(Candidates(mixture)(P[:0])[1][0]) == 0


def test_every_expert_is_asked_with_every_margin(round_the_sphere):
    p = sample(QUADCOPTER_OBSTACLE, 3, 10)
    candidates = Candidates(round_the_sphere, 2, [Margin("radius", 0.1), Margin("radius", 0.2)])
    sources, plans = candidates(p)
    assert candidates.count == 6
    assert len(plans) == 6
    wider = Candidates(round_the_sphere, 8)(p + np.array([0, 0, 0, 0, 0, 0, 0.1]))
    for row in range(len(p)):
        expert = int(sources[row, 0])
        (column,) = np.flatnonzero(wider[0][row] == expert)
        np.testing.assert_allclose(plans[2].flat()[row], wider[1][column].flat()[row], atol=1e-5)
    assert candidates.sources[sources[0, 2]].name.endswith(f"expert {sources[0, 0]}, radius + 0.1")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"experts": 0}, ValueError, "experts: expected a whole number of at least 1, got 0"),
        ({"margins": [Margin("radius", 0.1)]}, ValueError, "expected a parameter of the context"),
    ],
)
def test_impossible_candidates_are_refused(mixture, arguments, error, message):
    with pytest.raises(error, match=message):
        Candidates(mixture, **arguments)
    with pytest.raises(TypeError, match="amount: expected a finite number"):
        Margin("radius", "wide")
