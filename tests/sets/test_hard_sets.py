"""Hard sets: made small, and the shipped ones against their declarations."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import ocp_envs
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.distribution import Uniform
from ocp_envs.problems import BENCHMARK, PAPER
from ocp_envs.problems.discs import PLANAR_QUADCOPTER
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets import hard_sets, making, reference
from ocp_envs.sets.discontinuity import off_centre, relative_cost_difference
from ocp_envs.sets.hard_sets import ONE_ROUND, NearEqualCosts, NearGoal, OutsideBox
from ocp_envs.sets.making import make, smaller
from ocp_envs.sets.near import near_goal, sample_near
from ocp_envs.sets.outside import excess, sample_outside
from ocp_envs.sets.sampling import sample
from ocp_envs.sets.splits import sets_of
from ocp_envs.system import Box, Coordinate
from tests.small_problems import DOUBLE_INTEGRATOR

FEW = GenerationSettings(first=ONE_ROUND, starts=3, chunk=10)
SHIPPED = [
    (problem, name)
    for problem in BENCHMARK
    for name in sets_of(problem).hard
    if reference.path_of(problem, name).exists()
]


def test_problems_near_the_jump(tmp_path, monkeypatch):
    wide = NearEqualCosts(seed=1, drawn=40, size=3, limit=0.4, slack=0.5, spare=3.0, cheap=FEW, settings=FEW)
    made, record = make(PENDULUM, "boundary", wide, tmp_path, workers=1)
    assert len(made) == 3
    assert (relative_cost_difference(made.mode_costs) < 0.4).all()
    assert np.isin(made.parameters, sample(PENDULUM, 1, 40)).all()
    assert record["confirmed"] <= record["candidates"] <= record["within_slack"] < record["drawn"]
    assert 0 < record["share_within_limit"] < 0.5
    assert record["search"]["compared"] == record["candidates"]
    # An independent search agrees about the costs of both modes.
    for p, costs in zip(made.parameters, made.mode_costs):
        known = ocp_envs.solve(PENDULUM, p, seed=9).modes.cost
        np.testing.assert_allclose(np.sort(costs)[:2], np.sort(known)[:2], rtol=1e-5)
    # The same call reads what is there.
    for module in (hard_sets, making):
        monkeypatch.setattr(module, "generate", lambda problem, path, *_, **__: ocp_envs.Database.open(path, problem))
    again, _ = make(PENDULUM, "boundary", wide, tmp_path, workers=1)
    np.testing.assert_array_equal(again.mode_costs, made.mode_costs)
    with pytest.raises(RuntimeError, match=r"candidates for 'boundary'.*400 are wanted"):
        make(PENDULUM, "boundary", dataclasses.replace(wide, size=400, spare=9 / 400), tmp_path, workers=1)


def test_problems_outside_the_box(tmp_path):
    few = OutsideBox(seed=2, size=4, settings=FEW)
    made, record = make(DOUBLE_INTEGRATOR, "outside", few, tmp_path, workers=1)
    np.testing.assert_array_equal(made.parameters, sample_outside(DOUBLE_INTEGRATOR, 2, 4, (0.1, 0.25)))
    best = [ocp_envs.solve(DOUBLE_INTEGRATOR, p, extrapolate=True).cost for p in made.parameters]
    np.testing.assert_allclose(made.cost, best, rtol=1e-6)
    assert (record["candidates"], record["unsolved"], record["search"]) == (4, 0, None)


def test_problems_near_the_goal(tmp_path):
    few = NearGoal(seed=2, coordinates=("x",), size=4, settings=FEW)
    made, record = make(DOUBLE_INTEGRATOR, "near", few, tmp_path, workers=1)
    np.testing.assert_array_equal(made.parameters, sample_near(DOUBLE_INTEGRATOR, 2, 4, 0.15, ("x",)))
    best = [ocp_envs.solve(DOUBLE_INTEGRATOR, p).cost for p in made.parameters]
    np.testing.assert_allclose(made.cost, best, rtol=1e-6)
    assert (record["fraction"], record["coordinates"], record["search"]) == (0.15, ["x"], None)


def test_the_better_cost_of_a_mode_is_kept(tmp_path, monkeypatch):
    cheap = np.array([[2.0, 1.0, np.inf], [3.0, 5.0, 4.0], [1.0, np.inf, np.inf]])
    search = np.array([[np.inf, 1.1, 0.5], [2.0, 6.0, np.inf], [1.0, 1.02, 9.0]])
    database = SimpleNamespace(costs=lambda: search, totals=dict, settings={})
    monkeypatch.setattr(making, "generate", lambda *_, **__: database)

    class Given(NearEqualCosts):
        def candidates(self, problem, folder, workers):
            return hard_sets.Candidates(np.arange(6.0).reshape(3, 2), cheap, {})

    made, record = make(PENDULUM, "given", Given(seed=2, drawn=3, size=1), tmp_path)
    # Best of both: gaps of 100 %, 100 % and 2 %.
    np.testing.assert_array_equal(made.parameters, [[4.0, 5.0]])
    np.testing.assert_array_equal(made.mode_costs, [[1.0, 1.02, 9.0]])
    told = {key: record["search"][key] for key in ("compared", "found_better", "missed")}
    assert told == {"compared": 3, "found_better": 2, "missed": 0}
    search[:] = [[np.inf] * 3, [3.1, 5.0, 4.0], [1.0, 1.01, 9.0]]
    _, record = make(PENDULUM, "given", Given(seed=2, drawn=3, size=1), tmp_path)
    assert (record["search"]["found_better"], record["search"]["missed"], record["unsolved"]) == (0, 2, 0)


def test_a_smaller_set_has_a_share_of_the_draws():
    whole = sets_of(PENDULUM).boundary
    part = smaller(whole, 50)
    assert (part.size, part.drawn) == (50, whole.drawn * 2 * 50 // whole.size)
    assert smaller(sets_of(PENDULUM).outside, 50).size == 50


# -- declarations ------------------------------------------------------------------------------------------------------


def test_which_problems_have_which_sets():
    names = {p.id: sorted(sets_of(p).hard) for p in (*BENCHMARK, DOUBLE_INTEGRATOR)}
    near = [problem.id for problem in (*PAPER, DOUBLE_INTEGRATOR)]
    for problem in (*BENCHMARK, DOUBLE_INTEGRATOR):
        wanted = [
            "outside",
            *(["near"] if problem.id in near else []),
            *(["boundary"] if len(problem.modes) > 1 and problem is not PLANAR_QUADCOPTER else []),
        ]
        assert names[problem.id] == sorted(wanted)
    assert {name for there in names.values() for name in there} == set(reference.HARD)
    with pytest.raises(ValueError, match="no hard set 'boundry'; did you mean 'boundary'"):
        sets_of(PENDULUM).hard_set("boundry")


@pytest.mark.parametrize("problem", [*BENCHMARK, DOUBLE_INTEGRATOR], ids=lambda problem: problem.id)
def test_every_set_has_a_seed_of_its_own(problem):
    random = [split for split in sets_of(problem).splits.values() if split.grid is None]
    seeds = [made.seed for made in (*random, *sets_of(problem).hard.values())]
    assert len(set(seeds)) == len(seeds)
    assert 303 not in seeds  # the table of starts


def test_a_problem_whose_initial_state_is_fixed_has_no_set_near_the_goal():
    mass = Box((Coordinate("mass", 0.5, 2.0, "kg"),))
    fixed = dataclasses.replace(DOUBLE_INTEGRATOR, parameters=mass, rest=np.array([3.0, 0.0]))
    assert list(sets_of(fixed).hard) == ["outside"]


def test_searches_are_exhaustive_where_modes_compete():
    for problem in (PENDULUM, VEHICLE):
        assert sets_of(problem).boundary.settings.starts >= 40


# -- what is shipped ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("problem", "name"), SHIPPED, ids=lambda value: getattr(value, "id", value))
def test_shipped_sets_are_those_that_are_declared(problem, name):
    shipped, declared = reference.load(problem, name), sets_of(problem).hard_set(name)
    p = shipped.parameters
    assert len(shipped) == declared.size >= (500 if problem in PAPER else 90)
    assert shipped.mode_costs.shape == (declared.size, len(problem.modes))
    assert np.isfinite(shipped.cost).all()
    assert reference.path_of(problem, name).stat().st_size < 150_000
    if name == "outside":
        assert ((excess(problem, p) > declared.beyond[0]) & (excess(problem, p) <= declared.beyond[1])).all()
        if isinstance(problem.distribution, Uniform):
            drawn = sample_outside(problem, declared.seed, 510, declared.beyond)
            assert (p[:, None] == drawn[None]).all(axis=2).any(axis=1).all()
        return
    assert problem.parameters.contains(p).all()
    if name == "near":
        assert near_goal(problem, declared.fraction, declared.coordinates).contains(p).all()
        assert (problem.goal_error(problem.start(p)[0]) >= problem.goal.radius).all()
        if isinstance(problem.distribution, Uniform):
            drawn = sample_near(problem, declared.seed, declared.size, declared.fraction, declared.coordinates)
            np.testing.assert_allclose(p, drawn, rtol=1e-12)
        return
    if isinstance(problem.distribution, Uniform):
        assert (relative_cost_difference(shipped.mode_costs) < declared.limit).all()
        drawn = {row.tobytes() for row in sample(problem, declared.seed, declared.drawn)}
        assert all(row.tobytes() in drawn for row in p)
    else:
        assert (off_centre(problem, p) < declared.limit + 0.03).all()  # interpolated paths are off by 0.02 m, r ≥ 1 m


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_shipped_sets_share_nothing(problem):
    names = [n for n in (*reference.SHIPPED, *reference.HARD) if reference.path_of(problem, n).exists()]
    together = np.concatenate([reference.load(problem, name).parameters for name in names])
    assert len(np.unique(together, axis=0)) == len(together)
