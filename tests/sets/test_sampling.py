"""Parameters: uniform, on a grid, and drawn where an obstacle is in the way."""

import dataclasses
import json
import sys
import types

import numpy as np
import pytest

from ocp_envs import tables
from ocp_envs.distribution import Blocked, Distribution
from ocp_envs.envs.env import Env
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problems import BENCHMARK
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.sets import free_paths, sampling
from ocp_envs.sets.outside import sample_outside
from ocp_envs.sets.sampling import grid, sample
from ocp_envs.sets.splits import sets_of
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.solutions import Solutions
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.system import Box, Coordinate
from scripts import make_starts
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR

#: Few solves, of large problems.
pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
#: Rows of samples that need solutions, and of those that are drawn with ``-m slow``.
ROWS, MANY_ROWS = 24, 60
#: The first row of a sample with seed 5, of a draw from outside the box with seed 5, and of a reset with seed 3.
RECORDED = {
    "PendulumSwingup-v0": (
        [4.610261806452186, 0.362082578290837],
        [5.3278519057050575, -2.202882060866429],
        [0.5381495885689892, -1.0527579736156012],
    ),
    "GroundVehicle-v0": (
        [4.674919108892725, 1.8104128914541846, -1.8358905709213134, -0.35114882864300956],
        [8.698849171363364, -11.014410304332145, -2.5201791145459826, 2.019137242646435],
        [-8.287016657127513, -5.263789868078006, 1.8929632932132208, 0.5094046235990803],
    ),
    "Quadcopter-v0": (
        [4.674919108892725, 1.8104128914541846, -5.843821186758578],
        [-11.014410304332145, -10.027474088923727, 6.5133459440207595],
        [-8.287016657127513, -5.263789868078006, 6.025489304127937],
    ),
    "QuadcopterObstacle-v0": (
        [
            7.9303295673031435,
            1.0993374680563779,
            9.913497440215085,
            7.033067607152699,
            0.7436551304005707,
            5.789286394680044,
            2.359827736257148,
        ],
        [
            9.912911959128927,
            1.3741718350704737,
            12.39187180026886,
            8.791334508940874,
            0.9295689130007148,
            7.236607993350056,
            2.199784670321435,
        ],
        [
            -4.518065845899835,
            6.79567910339345,
            -6.691911403808253,
            -0.053510152500583885,
            0.20072213891820745,
            -3.476898824520287,
            2.4018967527417003,
        ],
    ),
    "PendulumUncertain-v0": (
        [4.610261806452186, 0.362082578290837, 0.8246853643972426, 0.966017855292612],
        [5.3278519057050575, -2.202882060866429, 0.6991757773322882, 1.1954003783206228],
        [0.5381495885689892, -1.0527579736156012, 1.1807646791238382, 1.0492972216386207],
    ),
    "CartPoleSwingup-v0": (
        [1.4686691528623932, 0.5431238674362557],
        [2.1862592521152644, -3.3043230912996435],
        [-2.603443065020804, -1.5791369604234018],
    ),
    "RocketLanding-v0": (
        [116.87297772231813, 918.1041289145419, -11.687642373517155, -16.6991072353694],
        [217.4712292840842, 789.8558969566785, -20.054948177847454, -5.229981083968859],
        [-207.17541642818782, 847.36210131922, 12.050978608255875, -12.535138918068967],
    ),
    "TwoLinkArm-v0": (
        [1.0284822039563997, 1.2790987412586157, -1.8358905709213134],
        [-2.423170266953072, 0.5984202398868856, 2.0462279768024496],
        [-1.823143664568053, 0.8723320825855145, 1.8929632932132208],
    ),
    "PlanarQuadcopterDiscs-v0": (
        [
            0.9349838217785451,
            -5.891375226512749,
            -0.8765731780137866,
            0.6660178552926119,
            -4.301201401053215,
            0.5327721295191079,
            0.8460329663740459,
            -1.6759272332907509,
            1.0438619005636038,
            0.43565415269602853,
        ],
        [
            1.1687297772231813,
            -5.864219033140936,
            -1.0957164725172333,
            0.6575223191157651,
            -4.376501751316519,
            0.6659651618988853,
            0.8825412079675574,
            -1.5949090416134386,
            1.3048273757045048,
            0.36956769087003566,
        ],
        [
            -1.6574033314255026,
            -6.31582739208468,
            0.9038233956191908,
            0.7492972216386207,
            -4.48704562931152,
            -0.2006191792905785,
            0.6874307788845004,
            -2.4083133024355057,
            0.7037314542276434,
            0.4682032119528421,
        ],
    ),
    "QuadcopterRecovery-v0": (
        [
            4.674919108892725,
            1.8104128914541846,
            -5.843821186758578,
            -0.33982144707387985,
            -1.5060070052660792,
            1.0655442590382158,
            0.2920659327480918,
            0.3240727667092491,
            0.6959079337090692,
            -1.7623056486931432,
            -1.6043958542277963,
            1.0421353510433216,
        ],
        [
            5.843648886115908,
            2.2630161143177308,
            -7.304776483448222,
            -0.42477680884235003,
            -1.882508756582599,
            1.3319303237977707,
            0.3650824159351147,
            0.4050909583865614,
            0.8698849171363365,
            -2.202882060866429,
            -2.0054948177847454,
            1.3026691888041517,
        ],
        [
            -8.287016657127513,
            -5.263789868078006,
            6.025489304127937,
            0.4929722163862067,
            -2.4352281465576047,
            -0.401238358581157,
            -0.025138442230999147,
            -0.4083133024355057,
            0.46915430281842907,
            -1.5453119203143864,
            -0.43508723801735183,
            0.0669607304854547,
        ],
    ),
}


def test_a_sample_depends_on_seed_and_index_alone():
    np.testing.assert_array_equal(sample(PENDULUM, 5, 100)[:7], sample(PENDULUM, 5, 7))
    assert not np.allclose(sample(PENDULUM, 5, 7), sample(PENDULUM, 6, 7))


@pytest.mark.parametrize("problem", BENCHMARK, ids=lambda problem: problem.id)
def test_draws_are_those_of_the_shipped_sets_for_ever(problem):
    drawn, outside, reset = RECORDED[problem.id]
    np.testing.assert_allclose(sample(problem, 5, 1)[0], drawn, rtol=1e-12)
    np.testing.assert_allclose(sample_outside(problem, 5, 1, (0.1, 0.25))[0], outside, rtol=1e-12)
    np.testing.assert_allclose(Env(problem).reset(seed=3)[1]["parameters"], reset, rtol=1e-12)


def test_samples_are_uniform_on_the_box():
    p, box = sample(PENDULUM, 0, 20_000), PENDULUM.parameters
    assert box.contains(p).all()
    unit = (p - box.lower) / box.width
    # Five standard errors of mean, second moment and correlation of a uniform variable.
    np.testing.assert_allclose(unit.mean(axis=0), 1 / 2, atol=5 / np.sqrt(12 * len(p)))
    np.testing.assert_allclose((unit**2).mean(axis=0), 1 / 3, atol=5 * np.sqrt(4 / 45 / len(p)))
    assert abs(np.corrcoef(unit.T)[0, 1]) < 5 / np.sqrt(len(p))


def test_the_grid_has_both_ends_and_the_papers_size():
    p, box = grid(PENDULUM, (61, 21)), PENDULUM.parameters
    assert p.shape == (1281, 2)
    np.testing.assert_array_equal(p[[0, -1]], [box.lower, box.upper])
    np.testing.assert_allclose(np.diff(np.unique(p[:, 0])), 2 * np.pi / 60)
    assert (np.diff(p[:21, 1]) > 0).all()


@pytest.mark.parametrize(
    "call", [lambda: sample(PENDULUM, -1, 3), lambda: grid(PENDULUM, (3,)), lambda: grid(PENDULUM, (3, 1))]
)
def test_bad_sizes_are_refused(call):
    with pytest.raises(ValueError, match="expected"):
        call()


# -- where an obstacle is in the way -----------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[ROWS, pytest.param(MANY_ROWS, marks=pytest.mark.slow)])
def drawn(request):
    return sample(QUADCOPTER_OBSTACLE, 5, request.param)


@pytest.fixture(scope="module")
def plans(drawn):
    """Optimal trajectories of the free problem."""
    windings = np.zeros(len(drawn), np.int64)
    line = guesses(QUADCOPTER, drawn[:, :3], windings, np.random.default_rng(1), "line")
    with GuardedSolver(QUADCOPTER) as solver:
        solutions = solver.solve(drawn[:, :3], line, windings)
    assert solutions.solved.all()
    return solutions.trajectory


def positions(plans, points=50):
    """Positions along plans by integration: ``points`` in each interval, (B, points·(N − 1), 3)."""
    flow, path = QUADCOPTER.functions.flow(2), []
    x, s, h = plans.states[:, 0], np.empty((len(plans), 0)), plans.step[:, None] / points
    for k in range(QUADCOPTER.knots - 1):
        for _ in range(points):
            path.append(x[:, :3])
            x, _ = flow(x, plans.controls[:, k], s, h)
    return np.stack(path, axis=1)


def test_the_free_path_meets_the_obstacle_and_its_ends_do_not(drawn, plans):
    start, centre, radius = drawn[:, :3], drawn[:, 3:6], drawn[:, 6]
    assert QUADCOPTER_OBSTACLE.parameters.contains(drawn).all()
    assert (np.linalg.norm(centre, axis=1) > radius).all()
    assert (np.linalg.norm(centre - start, axis=1) > radius).all()
    depth = radius - np.linalg.norm(positions(plans) - centre[:, None], axis=2).min(axis=1)
    assert depth.min() > -1e-3
    assert 0.2 < np.median(depth) < 2
    at_knots = radius - np.linalg.norm(plans.states[:, :, :3] - centre[:, None], axis=2).min(axis=1)
    assert at_knots.min() < 0  # the dense path decides, not the knots


def test_dense_paths_are_those_of_the_plans(plans):
    path = free_paths.dense(free_paths.spines(QUADCOPTER_OBSTACLE, plans))
    knots = slice(None, None, free_paths.POINTS)
    np.testing.assert_allclose(path[:, knots], plans.states[:, :, :3], atol=1e-12)
    off = np.linalg.norm(path[:, :-1] - positions(plans, free_paths.POINTS), axis=2)
    assert off.max() < 5e-3
    assert np.median(off) < 2e-4


def test_a_conditioned_sample_depends_on_seed_and_index_alone(drawn):
    np.testing.assert_array_equal(sample(QUADCOPTER_OBSTACLE, 5, 7), drawn[:7])
    assert not np.allclose(sample(QUADCOPTER_OBSTACLE, 6, 7), drawn[:7])
    assert sample(QUADCOPTER_OBSTACLE, 5, 0).shape == (0, 7)


def test_workers_and_chunks_change_nothing(drawn, monkeypatch):
    monkeypatch.setattr(sampling, "_CHUNK", 9)
    np.testing.assert_array_equal(sample(QUADCOPTER_OBSTACLE, 5, len(drawn), workers=2), drawn)


def test_interpolated_paths_decide_as_solved_ones_do(drawn, monkeypatch):
    monkeypatch.setattr(free_paths, "shipped", lambda problem: None)  # all are solved
    np.testing.assert_array_equal(sample(QUADCOPTER_OBSTACLE, 5, len(drawn)), drawn)


def test_the_table_is_as_accurate_as_it_says(drawn, plans):
    table = free_paths.shipped(QUADCOPTER_OBSTACLE)
    paths, difference = table(drawn[:, :3])
    errors = free_paths.distance(paths, free_paths.dense(free_paths.spines(QUADCOPTER_OBSTACLE, plans)))
    assert (errors <= table.tolerance(difference)).all()
    assert table.tolerance(difference).max() <= table.error < 0.03
    assert np.median(table.tolerance(difference)) < 0.015
    assert np.median(errors) < 1e-3


def test_what_the_free_problem_does_not_name_is_uniform_where_it_is_accepted():
    """A mass moves straight to the origin: walls between there and its start are accepted, and no others."""
    start = Box((Coordinate("x", 1.0, 5.0, "m"),))
    problem = dataclasses.replace(
        WALLED_INTEGRATOR,
        id="Walled-and-free",
        parameters=Box((*start.coordinates, WALLED_INTEGRATOR.parameters.coordinates[1])),
        clearance=lambda x, s, c: [((x[0] - s.wall) ** 2) ** 0.5 - 0.1],
        distribution=Blocked(dataclasses.replace(DOUBLE_INTEGRATOR, parameters=start)),
    )
    x, wall = sample(problem, 3, 300).T
    share = (wall - 0.1) / (x - 0.2)
    assert ((share > 0) & (share < 1)).all()
    np.testing.assert_allclose(share.mean(), 1 / 2, atol=5 / np.sqrt(12 * len(x)))
    np.testing.assert_allclose((share**2).mean(), 1 / 3, atol=5 * np.sqrt(4 / 45 / len(x)))
    assert abs(np.corrcoef(x, share)[0, 1]) < 5 / np.sqrt(len(x))


def test_a_free_problem_that_is_not_solved_is_an_error(drawn):
    def solve(parameters, guesses, windings):
        return types.SimpleNamespace(trajectory=guesses, solved=np.arange(len(parameters)) > 0)

    with pytest.raises(RuntimeError, match="no optimal trajectory was found for 1 parameters"):
        free_paths.solve_free(QUADCOPTER_OBSTACLE, drawn[:3, :3], types.SimpleNamespace(solve=solve))


def test_what_was_not_solved_is_tried_again(drawn):
    solver, tries = Solver(QUADCOPTER), []

    def solve(parameters, guesses, windings):
        tries.append(len(parameters))
        found = solver.solve(parameters, guesses, windings)
        if len(tries) == 1:
            nothing = Solutions.empty(QUADCOPTER, 1)
            assert found.solved.all()
            found = found.replaced(np.array([False, True, False]), nothing)
        return found

    found = free_paths.solve_free(QUADCOPTER_OBSTACLE, drawn[:3, :3], types.SimpleNamespace(solve=solve))
    assert tries == [3, 1]
    assert found.finite.all()
    np.testing.assert_allclose(found.states[:, 0, :3], drawn[:3, :3])


@pytest.mark.parametrize(
    "change",
    [
        {"clearance": None},
        {"distribution": Blocked(PENDULUM)},
        {"distribution": Blocked(QUADCOPTER_OBSTACLE), "parameters": QUADCOPTER.parameters},
    ],
    ids=["nothing to be free of", "another system", "more parameters"],
)
def test_a_free_problem_must_fit(change):
    with pytest.raises(ValueError, match="free must be this problem without its path constraint"):
        dataclasses.replace(QUADCOPTER_OBSTACLE, **change)


def test_the_radius_must_be_a_coordinate_of_the_context():
    with pytest.raises(ValueError, match=r"radius of the obstacle must be .* \['cx', 'cy', 'cz', 'radius'\], got 'x'"):
        dataclasses.replace(QUADCOPTER_OBSTACLE, distribution=Blocked(QUADCOPTER, radius="x"))


def test_a_distribution_of_ones_own_is_sampled():
    class Corner(Distribution):
        text = "in the corner"

        def check(self, problem):
            pass

        def draw(self, problem, generators):
            return np.tile(problem.parameters.lower, (len(generators), 1))

        def over(self, change):
            return self

    problem = dataclasses.replace(PENDULUM, distribution=Corner())
    _, info = Env(problem).reset()
    np.testing.assert_array_equal(info["parameters"], PENDULUM.parameters.lower)
    np.testing.assert_array_equal(sample(problem, seed=0, n=2), np.tile(PENDULUM.parameters.lower, (2, 1)))


# -- the table of starts -----------------------------------------------------------------------------------------------


def test_the_starts_are_drawn_as_the_sets_are_and_share_nothing_with_them():
    starts, box = tables.starts(QUADCOPTER_OBSTACLE), QUADCOPTER_OBSTACLE.parameters
    assert starts.shape == (10_000, 7)
    assert starts.dtype == np.float64
    assert len(np.unique(starts, axis=0)) == len(starts)
    assert 303 not in {split.seed for split in sets_of(QUADCOPTER_OBSTACLE).splits.values()}
    np.testing.assert_allclose(starts[:20], sample(QUADCOPTER_OBSTACLE, 303, 20), rtol=1e-12)
    unit = ((starts - box.lower) / box.width)[:, :3]  # these alone are uniform
    np.testing.assert_allclose(unit.mean(axis=0), 1 / 2, atol=5 / np.sqrt(12 * len(unit)))
    np.testing.assert_allclose((unit**2).mean(axis=0), 1 / 3, atol=5 * np.sqrt(4 / 45 / len(unit)))


def test_environments_draw_from_the_table_by_their_seeds():
    starts = tables.starts(QUADCOPTER_OBSTACLE)
    env, envs = Env(QUADCOPTER_OBSTACLE), VectorEnv(QUADCOPTER_OBSTACLE, 4)
    _, info = env.reset(seed=3)
    _, infos = envs.reset(seed=3)
    assert (starts == info["parameters"]).all(axis=1).any()
    np.testing.assert_array_equal(infos["parameters"][0], info["parameters"])
    assert len(np.unique(infos["parameters"], axis=0)) == 4
    np.testing.assert_array_equal(env.reset(seed=3)[1]["parameters"], info["parameters"])
    assert not np.array_equal(env.reset()[1]["parameters"], info["parameters"])


def test_without_a_table_reset_says_what_to_do():
    problem = dataclasses.replace(QUADCOPTER_OBSTACLE, id="Another-v0")
    env = Env(problem)
    with pytest.raises(tables.TableError, match=r"no table 'starts'.*pass options=\{\"parameters\": p\}"):
        env.reset()
    env.reset(options={"parameters": [9.0, 9, 9, 4, 4, 4, 2]})


def test_tables_come_back_and_belong_to_their_problem(tmp_path):
    values = np.random.default_rng(0).normal(size=(3, 2))
    path = tables.save(PENDULUM, "some", tmp_path, values=values, names=np.array(["a", "b"]))
    found = tables.load(PENDULUM, "some", tmp_path)
    np.testing.assert_array_equal(found["values"], values)
    assert found["names"].tolist() == ["a", "b"]
    assert [p.name for p in path.parent.iterdir()] == ["some.npz"]
    other = dataclasses.replace(PENDULUM, knots=30)
    with pytest.raises(tables.TableError, match="made for a problem with fingerprint"):
        tables.load(other, "some", tmp_path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(tables.TableError, match="damaged"):
        tables.load(PENDULUM, "some", tmp_path)
    with pytest.raises(tables.TableError, match=r"make_starts\.py"):
        tables.load(PENDULUM, "none", tmp_path)


def run_script(monkeypatch, tmp_path, *arguments):
    monkeypatch.setattr(sys, "argv", ["make_starts.py", "--results", str(tmp_path), *arguments])
    make_starts.main()


@pytest.mark.slow
def test_the_script_makes_both_tables_and_keeps_those_that_are_there(monkeypatch, tmp_path):
    written = {}

    def save(problem, name, **arrays):
        written[problem.id, name] = arrays
        return name

    monkeypatch.setattr(tables, "save", save)
    with pytest.raises(SystemExit):
        run_script(monkeypatch, tmp_path, "--again")  # the package is replaced only on request
    run_script(monkeypatch, tmp_path)
    assert (written, list(tmp_path.iterdir())) == ({}, [])
    sizes = ["--paths", "60", "--fresh", "5", "--starts", "3"]
    run_script(monkeypatch, tmp_path, "--again", "--ship", *sizes)
    starts = written["QuadcopterObstacle-v0", "starts"]["parameters"]
    np.testing.assert_allclose(starts, tables.starts(QUADCOPTER_OBSTACLE)[:3], rtol=1e-12)
    table = written["Quadcopter-v0", "paths"]
    assert (table["spines"].shape, table["spines"].dtype) == ((60, 20, 2, 3), np.int16)
    begin = table["spines"][:, 0, 0] * table["unit"][0]
    np.testing.assert_allclose(begin, table["parameters"], atol=10 / np.iinfo(np.int16).max)
    record = json.loads((tmp_path / "starts_QuadcopterObstacle-v0.json").read_text())
    assert record["errors"]["1"] == table["error"] > 0.01
    with pytest.raises(SystemExit, match="uniformly"):
        run_script(monkeypatch, tmp_path, "--env", "PendulumSwingup-v0")


@pytest.mark.parametrize("packed", [True, False], ids=["as now", "as earlier"])
def test_a_table_of_paths_is_kept_without_loss(monkeypatch, packed):
    table, kept = free_paths.shipped(QUADCOPTER_OBSTACLE), {}
    monkeypatch.setattr(free_paths.tables, "save", lambda problem, name, **arrays: kept.update(arrays))
    free_paths.ship(QUADCOPTER_OBSTACLE, table)
    if not packed:
        whole = free_paths.unpack(kept.pop("packed").tobytes())
        kept["spines"] = whole.reshape(table.spines.shape).astype(np.int16)
    monkeypatch.setattr(free_paths.tables, "load", lambda problem, name: kept)
    again = free_paths.shipped.__wrapped__(QUADCOPTER_OBSTACLE)
    for name in ("scale", "parameters", "spines", "error", "ratio"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
