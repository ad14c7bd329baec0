import copy
import ctypes
import hashlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import numpy as np
import pytest

from ocp_envs.solvers import guard
from ocp_envs.solvers.guard import Guard
from ocp_envs.solvers.guesses import guesses
from ocp_envs.solvers.nlp import SolverSettings, Status
from ocp_envs.solvers.nlp_solver import NlpSolver
from ocp_envs.solvers.solutions import make_tasks
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support.compiler import CompiledNotAvailable
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.threads import in_threads

pytestmark = pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable")
HURRIED = SolverSettings(hang_floor=0.3, hang_factor=1.0)
#: Starts at which the solvers below misbehave.
HANGS, CRASHES, HANGS_TWICE, CRASHES_TWICE, SLEEPS = 1.0, 2.0, 3.0, 4.0, 5.0


@pytest.fixture(scope="module", autouse=True)
def _interpreted(tmp_path_factory):
    """Children inherit the environment: without a compiler they start at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", "")
        yield


class Troubled(NlpSolver):
    """Hangs and crashes inside a C call, as a solver does, for some start states."""

    def solve(self, task, skip_primary=False):
        start = task.parameter[0]
        if start in (HANGS, HANGS_TWICE) and (not skip_primary or start == HANGS_TWICE):
            hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)  # for an hour
        if start == SLEEPS and not skip_primary:
            ctypes.CDLL(None).pause()
        if start in (CRASHES, CRASHES_TWICE) and (not skip_primary or start == CRASHES_TWICE):
            ctypes.string_at(0)
        return super().solve(task, skip_primary)


TROUBLED = partial(Guard, factory=Troubled)


class Unborn:
    def __init__(self, transcription, settings):
        raise ZeroDivisionError("a solver that cannot be made")


def die(number, transcription, settings):
    os.kill(os.getpid(), number)


def arguments(positions):
    p = np.column_stack([positions, np.zeros(len(positions))])
    windings = np.zeros(len(p), dtype=int)
    return p, guesses(DOUBLE_INTEGRATOR, p, windings, np.random.default_rng(0), "line"), windings


def test_guarded_and_unguarded_solutions_are_the_same():
    batch = arguments(np.linspace(-4, 4, 24))
    expected = Solver(DOUBLE_INTEGRATOR).solve(*batch)
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        for _ in range(2):
            found = solver.solve(*batch)
            np.testing.assert_array_equal(found.trajectory.flat(), expected.trajectory.flat())
            np.testing.assert_array_equal(found.status, expected.status)
        assert solver.restarts == 0


def test_hang_and_crash_end_in_the_fallback_and_lose_nothing_else():
    positions = np.array([0.5, HANGS, 1.5, CRASHES, 2.5, 3.5])
    with GuardedSolver(DOUBLE_INTEGRATOR, HURRIED, TROUBLED) as solver:
        found = solver.solve(*arguments(positions))
        assert solver.restarts == 3  # a crash is tried twice
    assert (found.status == Status.SOLVED).all()
    np.testing.assert_array_equal(found.fallback, np.isin(positions, [HANGS, CRASHES]))
    assert (np.diff(found.cost) > 0).all()  # farther is dearer: every result stands at its own place


def test_hang_and_crash_of_both_solvers_are_values(monkeypatch):
    positions = np.array([0.5, HANGS_TWICE, CRASHES_TWICE, 0.7])
    monkeypatch.setattr(guard, "UNKNOWN_LIMIT", 0.1)
    with GuardedSolver(DOUBLE_INTEGRATOR, HURRIED, TROUBLED) as solver:
        found = solver.solve(*arguments(positions))
        assert solver.restarts == 5
    expected = [Status.SOLVED, Status.TIMED_OUT, Status.CRASHED, Status.SOLVED]
    np.testing.assert_array_equal(found.status, expected)
    assert np.isinf(found.cost[[1, 2]]).all()
    assert np.isnan(found.trajectory.flat()[[1, 2]]).all()


def test_what_hangs_is_given_up_where_no_rescue_is_asked_for():
    positions = np.array([0.5, HANGS, CRASHES, 0.7])
    with GuardedSolver(DOUBLE_INTEGRATOR, HURRIED, TROUBLED) as solver:
        found = solver.solve(*arguments(positions), rescue=False)
    np.testing.assert_array_equal(found.status, [Status.SOLVED, Status.TIMED_OUT, Status.CRASHED, Status.SOLVED])
    assert not found.fallback.any()


def test_a_process_that_sleeps_is_tried_twice_and_then_rescued(monkeypatch):
    monkeypatch.setattr(guard, "WALL_FACTOR", 0.3)
    with GuardedSolver(DOUBLE_INTEGRATOR, HURRIED, TROUBLED) as solver:
        monkeypatch.setattr(guard, "UNKNOWN_LIMIT", 0.3)
        found = solver.solve(*arguments([0.5, SLEEPS, 0.7]))
        assert solver.restarts == 2
    assert found.solved.all()
    np.testing.assert_array_equal(found.fallback, [False, True, False])


def test_limits_are_of_processor_time_and_follow_the_median(monkeypatch):
    """A process that is stopped for longer than its limit goes on as if nothing had happened."""
    settings = SolverSettings(hang_floor=0.01, hang_factor=30.0)
    with GuardedSolver(DOUBLE_INTEGRATOR, settings) as solver:
        assert solver.runner._limits().primary == guard.UNKNOWN_LIMIT
        solver.solve(*arguments([1.0, 2.0]))
        limits = solver.runner._limits()
        assert limits.primary < guard.UNKNOWN_LIMIT
        os.kill(solver.runner.process_id, signal.SIGSTOP)
        wake = threading.Timer(2 * limits.primary, os.kill, (solver.runner.process_id, signal.SIGCONT))
        wake.start()
        assert solver.solve(*arguments([1.5])).solved.all()
        assert solver.restarts == 0


def test_a_child_killed_from_outside_is_replaced():
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        solver.start()
        os.kill(solver.runner.process_id, signal.SIGKILL)
        batch = arguments([1.0, 2.0])
        found = solver.solve(*batch)
        assert solver.restarts == 1
    assert found.solved.all()
    assert not found.fallback.any()
    np.testing.assert_array_equal(found.trajectory.flat(), Solver(DOUBLE_INTEGRATOR).solve(*batch).trajectory.flat())


def test_an_interrupted_batch_leaves_nothing_to_the_next():
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        p, guess, windings = arguments(np.linspace(1, 4, 6))
        tasks = make_tasks(DOUBLE_INTEGRATOR, transcribe(DOUBLE_INTEGRATOR), p, guess, windings)
        next(interrupted := solver.runner.solve(tasks))
        interrupted.close()  # as an exception in the caller does
        found = solver.solve(*arguments([0.5, 1.5]))
    assert found.solved.all()
    assert found.cost[0] < found.cost[1]


def test_warnings_of_the_child_reach_the_parent():
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver, pytest.warns(CompiledNotAvailable, match="no C compiler"):
        solver.start()


def test_a_child_that_cannot_start_says_why():
    with (
        GuardedSolver(DOUBLE_INTEGRATOR, runner=partial(Guard, factory=Unborn)) as solver,
        pytest.raises(RuntimeError, match=r"exit code 1; it printed:\n(.|\n)*cannot be made"),
    ):
        solver.solve(*arguments([1.0]))


@pytest.mark.parametrize(
    ("number", "cure"),
    [(signal.SIGBUS, "remove that folder"), (signal.SIGKILL, "may lack memory")],
    ids=["damaged", "killed"],
)
def test_a_child_that_dies_before_it_prints_is_explained(number, cure, monkeypatch):
    monkeypatch.setenv("OCP_ENVS_CACHE", "/somewhere")
    setup = partial(Guard, factory=partial(die, number))
    with (
        GuardedSolver(DOUBLE_INTEGRATOR, runner=setup) as solver,
        pytest.raises(RuntimeError, match=rf"was ended by {number.name} \(exit code -{number:d}\)") as caught,
    ):
        solver.start()
    assert cure in str(caught.value)
    assert ("/somewhere" in str(caught.value)) == (number == signal.SIGBUS)


def _alive(process_id):
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{process_id}/stat") as file:
        return file.read().rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.skipif(not os.path.exists("/proc"), reason="needs /proc")
def test_the_child_dies_with_its_parent_even_inside_a_solve():
    code = (
        "import threading, time\n"
        "from tests.solvers.test_guard import DOUBLE_INTEGRATOR, HANGS, TROUBLED, arguments\n"
        "from ocp_envs.solvers.solver import GuardedSolver\n"
        "solver = GuardedSolver(DOUBLE_INTEGRATOR, runner=TROUBLED)\n"
        "solver.start()\n"
        "print(solver.runner.process_id, flush=True)\n"
        "solver.solve(*arguments([HANGS]))\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as parent:
        child = int(parent.stdout.readline())
        time.sleep(0.5)  # now it hangs
        assert _alive(child)
        parent.kill()
    deadline = time.monotonic() + 10
    while _alive(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(child)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_has_a_child_of_its_own_and_leaves_the_other_alone():
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        expected = solver.solve(*arguments([0.5])).cost
        ours = solver.runner.process_id
        if (forked := os.fork()) == 0:
            same = solver.solve(*arguments([0.5])).cost == expected
            other = solver.runner.process_id != ours
            solver.close()
            os._exit(0 if same.all() and other else 1)
        assert os.waitpid(forked, 0)[1] == 0
        assert solver.solve(*arguments([0.5])).cost == expected
        assert (solver.runner.process_id, solver.restarts) == (ours, 0)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_a_copy_has_a_child_of_its_own(duplicate):
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        expected = solver.solve(*arguments([0.5])).cost
        with duplicate(solver) as other:
            assert other.solve(*arguments([0.5])).cost == expected
            assert other.runner.process_id != solver.runner.process_id


def test_threads_that_share_a_solver_get_the_answers_to_their_own_tasks():
    with GuardedSolver(DOUBLE_INTEGRATOR) as solver:
        expected = [solver.solve(*arguments([number + 0.5])).cost for number in range(4)]
        for _ in range(3):
            assert in_threads(lambda number: solver.solve(*arguments([number + 0.5])).cost) == expected
        assert solver.restarts == 0
