"""Statistics of databases, accuracy of plans against the true equation, the figure and the script."""

from __future__ import annotations

import dataclasses
import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from moe_policy.experiments.data import accuracy_of, contents
from moe_policy.experiments.data_report import CostDifferences
from moe_policy.experiments.figures.data import data_figure
from moe_policy.experiments.figures.style import COLORS, STYLE
from ocp_envs.data.database import Database
from ocp_envs.data.layout import MISSING, StoredRows
from ocp_envs.goal import Modes
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers import accuracy as accuracy_module
from ocp_envs.solvers.accuracy import accuracy, integrate
from ocp_envs.solvers.nlp import Status
from ocp_envs.system import System
from ocp_envs.trajectory import Trajectory
from tests.small_problems import DOUBLE_INTEGRATOR, WALLED_INTEGRATOR, rest_to_rest, with_states

ROOT = Path(__file__).resolve().parents[2]
#: Modes by duration, so that the exact plans below can be of any of three.
TIMES = (4.0, 6.0, 8.0)


def by_duration(problem, parameters, trajectory, multipliers):
    return np.abs(trajectory.duration[:, None] - TIMES).argmin(axis=1)


INTEGRATOR = dataclasses.replace(DOUBLE_INTEGRATOR, modes=Modes(("quick", "medium", "slow"), by_duration))
#: What each of six problems has in its slots; the fourth row never came to an end.
HAVE = np.array([[1, 1, 1], [1, 1, 0], [0, 1, 1], [1, 1, 1], [0, 0, 1], [0, 0, 0]], dtype=bool)
STATUS = np.array([Status.SOLVED] * 5 + [Status.TIMED_OUT], dtype=np.int8)


def exact(parameters, duration):
    """Exact plans of the double integrator from rest, and their costs ∫ 1 + u²/2 dt."""
    plan = Trajectory(*rest_to_rest(parameters[:, 0], duration, INTEGRATOR.knots))
    return plan, duration * (1 + plan.controls[:, 0, 0] ** 2 / 2)


def made_by_hand(path, failures=(0,) * 6, fallbacks=(0,) * 6, interrupted=True):
    """A database of six problems in chunks of one, stored in another order, of which one chunk was interrupted."""
    parameters = np.stack([np.linspace(1.0, 1.5, 6), np.zeros(6)], axis=1)
    order = np.array([2, 0, 1, 5, 4, 3])
    cost, z = np.full((6, 3), np.inf), np.full((6, 3, INTEGRATOR.flat_size), np.nan)
    for mode, duration in enumerate(TIMES):
        plan, costs = exact(parameters, duration)
        cost[:, mode] = np.where(HAVE[:, mode], costs, np.inf)
        z[:, mode] = np.where(HAVE[:, mode, None], plan.flat(), np.nan)
    rows = StoredRows(
        status=np.where((np.arange(6) == 3) & interrupted, np.int8(MISSING), STATUS),
        slot_status=np.where(HAVE, Status.SOLVED, Status.EMPTY).astype(np.int8),
        cost=cost,
        z=z,
        multipliers=np.zeros((6, 3, INTEGRATOR.knots, 0)),
        solves=np.full(6, 4, np.int32),
        failures=np.array(failures, np.int32),
        fallbacks=np.array(fallbacks, np.int32),
        iterations=np.arange(6, dtype=np.int32),
    )
    database = Database.create(path, INTEGRATOR, parameters, order=order, chunk=1, settings={"margin": 0.1})
    for chunk in range(6):
        database.write(chunk, rows[order[[chunk]]])
    return Database.open(path, INTEGRATOR), cost


# -- statistics --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", [1, 4, 5000])
def test_statistics_are_those_of_the_problems_that_are_there(tmp_path, monkeypatch, block):
    monkeypatch.setattr("ocp_envs.data.database._BLOCK", block)
    database, cost = made_by_hand(tmp_path / "d.zarr")
    held = contents(database)
    there = [0, 1, 2, 4, 5]
    assert held.report.size == 6
    assert held.report.totals.to_json() == database.totals()
    assert (held.report.totals.problems, held.report.totals.solved, held.report.totals.iterations) == (5, 4, 12)
    assert {kind: count for kind, count in held.report.unsolved.items() if count} == {"TIMED_OUT": 1}
    np.testing.assert_array_equal(held.report.modes_found, [1, 1, 2, 1])
    np.testing.assert_array_equal([row.found for row in held.report.families], HAVE[there].sum(axis=0))
    winners = cost[there][:4].argmin(axis=1)
    np.testing.assert_array_equal([row.best for row in held.report.families], np.bincount(winners, minlength=3))
    assert max(row.best for row in held.report.families) < 4  # the winners differ
    lowest = np.sort(cost[[0, 1, 2]], axis=1)  # of the problems with two modes or more
    np.testing.assert_allclose(np.sort(held.differences), np.sort(lowest[:, 1] / lowest[:, 0] - 1))
    assert held.report.bytes == sum(path.stat().st_size for path in database.path.rglob("*") if path.is_file())
    assert (held.report.trajectories, held.report.failing, held.report.misfiled) == (8, 0, 0)


def rewrite(database, mode, change):
    """Change what is stored in the slot ``mode`` of the problem with number 2."""
    rows = database.stored(slice(0, 1))
    change(rows, mode)
    database.write(0, rows)


def shift_a_state(rows, mode):
    rows.z[0, mode, 4] += 1e-4


def claim_another_cost(rows, mode):
    rows.cost[0, mode] *= 1 + 1e-4


@pytest.mark.parametrize("change", [shift_a_state, claim_another_cost])
@pytest.mark.parametrize("mode", [1, 2], ids=["winner", "other"])
def test_a_stored_trajectory_that_is_no_solution_is_counted(tmp_path, change, mode):
    database, _ = made_by_hand(tmp_path / "d.zarr")
    rewrite(database, mode, change)
    held = contents(database)
    assert (held.report.trajectories, held.report.failing, held.report.misfiled) == (8, 1, 0)


def test_a_trajectory_in_the_slot_of_another_mode_is_counted(tmp_path):
    database, _ = made_by_hand(tmp_path / "d.zarr")

    def swap(rows, mode):
        rows.z[0, [1, 2]], rows.cost[0, [1, 2]] = rows.z[0, [2, 1]], rows.cost[0, [2, 1]]

    rewrite(database, 1, swap)
    held = contents(database)
    assert (held.report.failing, held.report.misfiled) == (0, 2)


def test_kinds_of_failures_are_known_only_where_there_are_none(tmp_path):
    none, _ = made_by_hand(tmp_path / "none.zarr")
    assert set(contents(none).report.failures_by_kind.values()) == {0}
    # The interrupted problem counts for nothing; of the others a time-out is a failure that went to the fallback.
    some, _ = made_by_hand(tmp_path / "some.zarr", failures=(2, 0, 1, 9, 0, 3), fallbacks=(1, 2, 0, 9, 0, 4))
    held = contents(some)
    assert held.report.failures_by_kind is None
    assert (held.report.totals.failures, held.report.killed_at_most) == (6, 1 + 0 + 0 + 0 + 3)


def test_the_record_of_a_database(tmp_path):
    database, _ = made_by_hand(tmp_path / "d.zarr", interrupted=False)
    held = contents(database)
    record = json.loads(json.dumps(held.report.to_json(), allow_nan=False))
    assert (record["problems"], record["size"], record["solves_per_problem"]) == (6, 6, 4)
    assert [row["mode"] for row in record["classes"]] == ["quick", "medium", "slow"]
    assert sum(row["share"] for row in record["classes"]) == pytest.approx(1)
    assert record["gap"]["problems"] == 4
    assert record["gap"]["quantiles"]["0.5"] == pytest.approx(np.median(held.differences))
    close = CostDifferences.of(np.array([0.0, 0.002, 0.02, 0.03]))
    assert close.share_below == {"0.001": 0.25, "0.01": 0.5, "0.03": 0.75}


def test_a_database_with_nothing_in_it(tmp_path):
    database = Database.create(tmp_path / "d.zarr", INTEGRATOR, sample(INTEGRATOR, 0, 3))
    held = contents(database)
    assert held.report.totals.problems == held.report.trajectories == sum(held.report.modes_found) == 0
    assert held.report.differences.quantiles is None
    assert accuracy_of(database, 3) is None
    assert data_figure(tmp_path / "empty.png", {"training": (held, None)}).exists()


# -- accuracy ----------------------------------------------------------------------------------------------------------


def test_plans_that_follow_the_equation_have_no_error():
    parameters = np.stack([np.linspace(-3, 3, 7), np.zeros(7)], axis=1)
    plan, _ = exact(parameters, 6.0)
    found = accuracy(INTEGRATOR, parameters, plan)
    assert found.interval.shape == (7, 20, 2)
    assert np.abs(found.interval).max() < 1e-12
    assert np.abs(found.open_loop).max() < 1e-11
    assert (found.goal < 1e-11).all()


def test_a_known_error_is_found_where_it_is():
    """A knot moved by (d, e) is off by that from before; from it on, by what the double integrator makes of it."""
    parameters = np.array([[2.0, 0.0], [-1.0, 0.0]])
    plan, _ = exact(parameters, 6.0)
    d, e, h = 0.01, -0.02, 0.3
    plan = with_states(plan, (0, 7), plan.states[0, 7] + [d, e])
    plan = with_states(plan, (1, -1), plan.states[1, -1] + [3.0, -4.0])
    found = accuracy(INTEGRATOR, parameters, plan)
    expected = np.zeros((2, 20, 2))
    expected[0, 6], expected[0, 7], expected[1, 19] = [-d, -e], [d + h * e, e], [-3.0, 4.0]
    np.testing.assert_allclose(found.interval, expected, atol=1e-11)
    np.testing.assert_allclose(found.open_loop, [[0, 0], [-3, 4]], atol=1e-10)  # open loop never sees the knots
    assert (found.goal < 1e-10).all()
    assert found.errors("open_loop", scaled=False).max() == pytest.approx(5.0)
    record = found.record()
    assert record["open_loop"]["state_units"] == pytest.approx({"median": 2.5, "95_percent": 4.75, "largest": 5.0})
    assert (record["cases"], record["end_in_the_goal_ball"], record["not_integrable"]) == (2, 2, 0)


def test_scaled_errors_are_divided_by_the_scales_of_the_coordinates():
    error = np.array([[5.0, 0, 0, 0], [0, 0, 0, 4.0], [0, 5.0, 2.0, 0]])
    found = accuracy_module.Accuracy(VEHICLE, error[:, None], error, np.zeros(3))
    np.testing.assert_allclose(found.errors("open_loop", scaled=True), [1, 1, np.sqrt(2)])
    np.testing.assert_allclose(found.errors("interval", scaled=False), [5, 4, np.sqrt(29)])


def linear(gain):
    """ẋ = (v, gain x + u): a problem with an exact solution that no Runge-Kutta step has."""
    system = DOUBLE_INTEGRATOR.system
    dynamics = lambda x, u, c: [x[1], gain * x[0] + u[0]]  # noqa: E731
    return dataclasses.replace(INTEGRATOR, system=System("spring", system.state, system.control, {}, dynamics))


@pytest.mark.parametrize("gain", [-4.0, 2.0], ids=["stable", "unstable"])
def test_the_error_of_runge_kutta_is_that_against_the_matrix_exponential(gain):
    problem, rng = linear(gain), np.random.default_rng(0)
    controls, h = rng.uniform(-1, 1, (3, 20, 1)), np.array([0.1, 0.2, 0.3])
    states = np.empty((3, 21, 2))
    states[:, 0] = parameters = sample(problem, 1, 3)
    flow = problem.functions.flow(1)
    true, jumps = np.array(parameters), np.empty((3, 20, 2))
    for k in range(20):
        states[:, k + 1] = flow(states[:, k], controls[:, k], np.empty((3, 0)), h[:, None])[0]
        for i in range(3):
            step = expm(h[i] * np.array([[0, 1, 0], [gain, 0, 1], [0, 0, 0]]))[:2]
            true[i] = step @ [*true[i], controls[i, k, 0]]
            jumps[i, k] = step @ [*states[i, k], controls[i, k, 0]] - states[i, k + 1]
    found = accuracy(problem, parameters, Trajectory(states, controls, 20 * h))
    assert np.abs(jumps).max() > 1e-5
    np.testing.assert_allclose(found.interval, jumps, atol=2e-9)
    np.testing.assert_allclose(found.open_loop, true - states[:, -1], atol=1e-9 * np.abs(true).max())


def test_a_constant_in_the_parameter_reaches_the_equation():
    """The context replaces the mass: twice the mass, half the acceleration."""
    box = dataclasses.replace(
        WALLED_INTEGRATOR.parameters,
        coordinates=(
            WALLED_INTEGRATOR.parameters.coordinates[0],
            dataclasses.replace(WALLED_INTEGRATOR.parameters.coordinates[1], name="mass", lower=0.5),
        ),
    )
    problem = dataclasses.replace(INTEGRATOR, parameters=box)
    plan, _ = exact(np.array([[2.0, 2.0], [2.0, 2.0]]), 6.0)
    plan = dataclasses.replace(plan, controls=2 * plan.controls)
    found = accuracy(problem, np.array([[2.0, 2.0], [2.0, 1.0]]), plan)
    assert found.goal[0] < 1e-10
    assert np.abs(found.interval[0]).max() < 1e-11
    assert found.goal[1] == pytest.approx(2.0)
    assert (np.abs(found.interval[1]).max(axis=1) > 0.01).all()


@pytest.mark.parametrize("problem", [PENDULUM, VEHICLE, QUADCOPTER], ids=lambda problem: problem.id)
def test_rows_together_are_as_accurate_as_one_by_one(problem):
    rng, system, rate = np.random.default_rng(2), problem.system, problem.functions.rate()
    x = problem.goal.state + 0.5 * system.state.scale * rng.uniform(-1, 1, (12, system.nx))
    u = problem.terminal.central_control + 0.5 * system.control.scale * rng.uniform(-1, 1, (12, system.nu))
    s, h = np.empty((12, 0)), rng.uniform(0.05, 0.5, 12)
    together = integrate(rate, x, u, s, h)
    for i in range(12):

        def f(t, y, i=i):
            return rate(y[None], u[i : i + 1], s[i : i + 1])[0][0]

        alone = solve_ivp(f, (0, h[i]), x[i], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        np.testing.assert_allclose(together[i] / system.state.scale, alone / system.state.scale, atol=1e-9)


def test_a_plan_that_escapes_is_counted_and_spoils_no_other():
    """ẋ = x² reaches infinity after 1/x_0 seconds, and x_0/(1 − t x_0) before."""
    system = DOUBLE_INTEGRATOR.system
    dynamics = lambda x, u, c: [x[0] ** 2, u[0]]  # noqa: E731
    escaping = System("escape", system.state, system.control, {}, dynamics)
    problem = dataclasses.replace(INTEGRATOR, system=escaping, hold=0.0)
    parameters = np.array([[0.5, 0.0], [-1.0, 0.0], [3.0, 0.0], [np.e / 10, 0.0]])
    states = np.zeros((4, 21, 2))
    found = accuracy(problem, parameters, Trajectory(states, np.zeros((4, 20, 1)), np.full(4, 1.0)))
    x = parameters[:, 0]
    np.testing.assert_array_equal(np.isfinite(found.open_loop[:, 0]), [True, True, False, True])
    np.testing.assert_allclose(found.open_loop[[0, 1, 3], 0], (x / (1 - x))[[0, 1, 3]], rtol=1e-8)
    record = found.record()
    assert (record["cases"], record["not_integrable"]) == (4, 1)
    assert record["open_loop"]["state_units"]["largest"] == pytest.approx(1.0, rel=1e-8)
    json.dumps(record, allow_nan=False)


def test_random_solved_problems_are_drawn(tmp_path):
    database, _ = made_by_hand(tmp_path / "d.zarr")
    found = accuracy_of(database, 300)
    assert len(found.goal) == 4  # five are there, four solved
    assert np.abs(found.open_loop).max() < 1e-10
    assert [len(accuracy_of(database, 2, seed).goal) for seed in range(5)] == [2] * 5
    assert not np.array_equal(accuracy_of(database, 2, 0).interval, accuracy_of(database, 2, 1).interval)


# -- figure ------------------------------------------------------------------------------------------------------------


def test_the_figure_has_a_colour_for_every_split(tmp_path):
    image = pytest.importorskip("matplotlib.image")
    database, _ = made_by_hand(tmp_path / "d.zarr")
    report = contents(database), accuracy_of(database, 3)
    path = data_figure(tmp_path / "new" / "data.png", {"training": report, "validation": report})
    picture = image.imread(path)[..., :3]
    assert picture.shape[1::-1] == tuple(round(length * STYLE["savefig.dpi"]) for length in (10.0, 7.0))
    colors = [np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255 for color in COLORS[:3]]
    seen = [bool((np.abs(picture - color).max(axis=-1) < 0.02).any()) for color in colors]
    assert seen == [True, True, False]


# -- the script --------------------------------------------------------------------------------------------------------


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.delitem(sys.modules, "report_data", raising=False)
    module = importlib.import_module("report_data")
    monkeypatch.setattr("ocp_envs.load", lambda name: INTEGRATOR)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["report_data", *map(str, arguments)])
        module.main()

    return run


def test_the_script_reports_what_is_there(script, tmp_path, capsys):
    folder = tmp_path / "data" / INTEGRATOR.id
    folder.mkdir(parents=True)
    made_by_hand(folder / "training.zarr", failures=(1, 0, 0, 0, 0, 1))
    made_by_hand(folder / "validation.zarr", interrupted=False)
    arguments = ("--data", tmp_path / "data", "--results", tmp_path / "results", "--accuracy-cases", 2)
    script(*arguments)
    names = [f"data_{INTEGRATOR.id}.json", f"data_{INTEGRATOR.id}.png"]
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == names
    record = json.loads((tmp_path / "results" / names[0]).read_text())
    assert set(record) == {"env_id", "splits", "integration", "provenance"}
    assert list(record["splits"]) == ["training", "validation"]
    training, validation = record["splits"].values()
    assert (training["problems"], validation["problems"]) == (5, 6)
    assert training["failures_by_kind"] is None
    assert validation["failures_by_kind"]["TIMED_OUT"] == 0
    assert training["accuracy"]["cases"] == 2
    assert training["settings"] == {"margin": 0.1}
    assert training["accuracy"]["open_loop"]["scaled"]["largest"] < 1e-10
    lines = {line.split("  ")[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["instances"].split()[1:] == ["5", "of", "6", "6", "of", "6"]
    assert " ".join(lines["instances with 0 / 1 / … families"].split()[8:]) == "1 / 1 / 2 / 1 1 / 1 / 2 / 2"
    assert lines["… not converged / timed out / crashed / check failed"].endswith("0 / 0 / 0 / 0")
    assert "not stored" in lines["… not converged / timed out / crashed / check failed"]
    script(*arguments, "--splits", "validation")
    assert list(json.loads((tmp_path / "results" / names[0]).read_text())["splits"]) == ["validation"]


def test_the_script_says_what_is_missing(script, tmp_path):
    arguments = ("--data", tmp_path, "--results", tmp_path / "results")
    for splits in ((), ("--splits", "training")):
        with pytest.raises(SystemExit, match=r"there is no database .*generate_data\.py"):
            script(*arguments, *splits)
    with pytest.raises(SystemExit, match="did you mean 'training'"):
        script(*arguments, "--splits", "trainings")
    with pytest.raises(SystemExit):
        script(*arguments, "--accuracy-cases", "0")
    assert not (tmp_path / "results").exists()
