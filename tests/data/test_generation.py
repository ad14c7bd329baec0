import dataclasses
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from moe_policy.experiments.interruptions import Kill, descendants, generate_interrupted, plan_kills, wait_for_chunks
from ocp_envs.data.database import Database
from ocp_envs.data.generation import generate
from ocp_envs.data.layout import DatabaseError
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.parameters import OutsideBoxError
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.check import verify
from ocp_envs.solvers.nlp import Status
from ocp_envs.support import tasks as support_tasks
from ocp_envs.support.pool import WorkerLostError
from ocp_envs.trajectory import Trajectory
from tests.data.running import COUNT, SMALL, InProcess
from tests.small_problems import DOUBLE_INTEGRATOR

needs_proc = pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="finds worker processes in /proc")
#: What the processes below run; arguments: folder, number of problems.
SCRIPT = """
import sys
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.data.generation import generate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
if __name__ == "__main__":
    settings = GenerationSettings(first=20, chunk=10, starts=2)
    generate(PENDULUM, sys.argv[1], sample(PENDULUM, 7, int(sys.argv[2])), workers=2, seed=3, settings=settings)
"""


# -- what is found -----------------------------------------------------------------------------------------------------


def test_every_problem_is_solved_and_every_trajectory_passes_the_check(whole):
    rows, p = whole.stored(slice(0, COUNT)), whole.stored_parameters(slice(0, COUNT))
    assert (rows.status == Status.SOLVED).all()
    row, mode = np.nonzero(np.isfinite(rows.cost))
    np.testing.assert_array_equal(np.isfinite(rows.cost), rows.slot_status == Status.SOLVED)
    plans = Trajectory.from_flat(rows.z[row, mode], PENDULUM.knots, 2, 1)
    assert verify(PENDULUM, p[row], plans, rows.cost[row, mode]).passed.all()
    found = PENDULUM.modes.classify(PENDULUM, p[row], plans, rows.multipliers[row, mode])
    np.testing.assert_array_equal(found, mode)


def test_warm_starts_find_what_mirrored_problems_have(tmp_path, unguarded):
    """θ → 2π − θ, ω → −ω maps optima to optima of the same cost and swaps the outer windings."""
    p = sample(PENDULUM, 11, 60)
    mirrored = np.stack([2 * np.pi - p[:, 0], -p[:, 1]], axis=1)
    database = generate(PENDULUM, tmp_path / "d", np.concatenate([p, mirrored]), executor=InProcess(), settings=SMALL)
    cost = database.costs().min(axis=1)
    np.testing.assert_allclose(cost[:60], cost[60:], rtol=1e-3)
    modes = database.samples().mode
    clear = np.sort(database.costs(), axis=1)
    clear = (clear[:, 1] > 1.001 * clear[:, 0])[:60]
    np.testing.assert_array_equal(modes[:60][clear], 2 - modes[60:][clear])


# -- interruptions and workers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 3])
def test_arrays_do_not_depend_on_the_workers(whole, tmp_path, threads):
    with ThreadPoolExecutor(threads) as executor:
        arguments = {"seed": 3, "settings": SMALL, "executor": executor}
        other = generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, COUNT), **arguments)
    assert other.digest() == whole.digest()


def command(path, count=COUNT):
    return [sys.executable, "-c", SCRIPT, str(path), str(count)]


@pytest.fixture
def importable(monkeypatch):
    """Processes that are started find what this one finds."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(entry or os.getcwd() for entry in sys.path))


def wait_for_end(pids):
    """Nobody is left behind (a process that has ended but was not reaped yet does not count)."""
    deadline = time.monotonic() + 30
    for pid in pids:
        while (stat := Path(f"/proc/{pid}/stat")).exists() and stat.read_text().rsplit(")", 1)[1].split()[0] != "Z":
            assert time.monotonic() < deadline, f"process {pid} outlived its parent"
            time.sleep(0.05)


@needs_proc
def test_a_killed_parent_loses_nothing_and_leaves_nobody_behind(whole, tmp_path, importable):
    path = tmp_path / "d"
    process = subprocess.Popen(command(path))
    wait_for_chunks(process, path, 1)
    others = descendants(process.pid)
    assert len(others) >= 4  # two workers and their solvers
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_for_end(others)
    database = Database.open(path)
    done = int(database.present().sum())
    assert 1 <= done < database.chunks
    executor = InProcess()
    again = generate(PENDULUM, path, sample(PENDULUM, 7, COUNT), executor=executor, seed=3, settings=SMALL)
    assert len(executor.tasks) == database.chunks - done
    assert again.digest() == whole.digest()


@needs_proc
def test_killed_processes_of_every_kind_change_nothing(whole, tmp_path, importable):
    path, kills = tmp_path / "d", [Kill("worker", 1, 0.05), Kill("solver", 2, 0.05), Kill("parent", 4, 0.0)]
    record = generate_interrupted(command(path), path, kills)
    assert record.kills_by_kind == {"worker": 1, "solver": 1, "parent": 1}
    assert record.chunks_written_again == 0
    assert Database.open(path).digest() == whole.digest()


@needs_proc
@pytest.mark.slow
def test_twenty_kills_at_random_moments_change_nothing(tmp_path, importable):
    count, path = 400, tmp_path / "d"
    undisturbed = generate(PENDULUM, tmp_path / "whole", sample(PENDULUM, 7, count), seed=3, settings=SMALL)
    kinds = ["parent"] * 8 + ["worker"] * 6 + ["solver"] * 6
    record = generate_interrupted(command(path, count), path, plan_kills(kinds, undisturbed.chunks, 0.3, seed=5))
    assert len(record.kills) == 20
    assert record.starts == 9
    assert record.chunks_written_again == 0
    database = Database.open(path)
    assert database.totals() == undisturbed.totals()
    assert database.digest() == undisturbed.digest()


class WhileItRuns(InProcess):
    """Calls ``meanwhile`` when the first task is submitted."""

    def __init__(self, meanwhile):
        super().__init__()
        self.meanwhile = meanwhile

    def submit(self, fn, /, *args, **kwargs):
        if not self.tasks:
            self.meanwhile()
        return super().submit(fn, *args, **kwargs)


def test_two_at_once_do_not_write_to_one_path(tmp_path, unguarded, importable):
    p, path = sample(PENDULUM, 7, 10), tmp_path / "d"

    def meanwhile():
        with pytest.raises(DatabaseError, match="being generated by another process"):
            generate(PENDULUM, path, p, executor=InProcess(), settings=SMALL)
        other = subprocess.run(command(path), capture_output=True, text=True)
        assert "DatabaseError: " in other.stderr

    database = generate(PENDULUM, path, p, executor=WhileItRuns(meanwhile), settings=SMALL)
    assert database.complete


def test_what_a_process_killed_early_left_is_removed(tmp_path, unguarded):
    for name in (".d.123", ".d.other.123"):  # the latter is another database's
        (tmp_path / name).mkdir()
    generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, 10), executor=InProcess(), settings=SMALL)
    assert not (tmp_path / ".d.123").exists()
    assert (tmp_path / ".d.other.123").exists()


class Dropping(InProcess):
    """Loses every task for the first ``losses`` times, in one of the ways there are."""

    def __init__(self, losses, error):
        super().__init__()
        self.losses, self.error = losses, error

    def submit(self, fn, /, *args, **kwargs):
        if self.losses == 0:
            return super().submit(fn, *args, **kwargs)
        self.losses -= 1
        future = Future()
        if self.error is None:
            future.cancel()
            future.set_running_or_notify_cancel()
        else:
            future.set_exception(self.error)
        return future


@pytest.mark.parametrize("error", [None, WorkerLostError("killed")])
def test_lost_tasks_are_submitted_again_but_not_for_ever(tmp_path, unguarded, error):
    p = sample(PENDULUM, 7, 20)
    assert generate(PENDULUM, tmp_path / "d", p, executor=Dropping(3, error), settings=SMALL).complete
    with pytest.raises((CancelledError, WorkerLostError)):
        generate(PENDULUM, tmp_path / "e", p, executor=Dropping(1000, error), settings=SMALL)


class Broken(InProcess):
    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("gone"))
        return future


def test_an_executor_that_is_not_ours_is_not_replaced(tmp_path, unguarded):
    with pytest.raises(BrokenExecutor, match="gone"):
        generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, 10), executor=Broken(), settings=SMALL)


@pytest.mark.parametrize("workers", [1, 3])
def test_an_executor_is_given_two_tasks_for_each_that_it_runs_at_once(tmp_path, unguarded, monkeypatch, workers):
    """``wait`` is called with the tasks in flight."""
    waiting, wait = [], support_tasks.wait

    def noted(futures, **how):
        waiting.append(len(futures))
        return wait(futures, **how)

    monkeypatch.setattr(support_tasks, "wait", noted)
    p, settings = sample(PENDULUM, 7, 20), dataclasses.replace(SMALL, first=20, chunk=2)
    generate(PENDULUM, tmp_path / "d", p, executor=InProcess(), workers=workers, settings=settings)
    assert max(waiting) == 2 * workers


def test_a_finished_database_is_not_solved_again(tmp_path, unguarded):
    p = sample(PENDULUM, 7, 10)
    first = generate(PENDULUM, tmp_path / "d", p, executor=InProcess(), settings=SMALL)
    executor = InProcess()
    assert generate(PENDULUM, tmp_path / "d", p, executor=executor, settings=SMALL).digest() == first.digest()
    assert executor.tasks == []


# -- bad input ---------------------------------------------------------------------------------------------------------


def test_another_call_at_the_same_path_is_refused(tmp_path, unguarded):
    p, executor = sample(PENDULUM, 7, 10), InProcess()
    generate(PENDULUM, tmp_path / "d", p, executor=executor, settings=SMALL)
    for change in ({"seed": 1}, {"settings": dataclasses.replace(SMALL, starts=3)}):
        with pytest.raises(DatabaseError, match="other parameters, settings or seed"):
            generate(PENDULUM, tmp_path / "d", p, **({"executor": executor, "settings": SMALL} | change))
    with pytest.raises(DatabaseError, match="other parameters, settings or seed"):
        generate(PENDULUM, tmp_path / "d", p + 1e-9, executor=executor, settings=SMALL)
    with pytest.raises(DatabaseError, match="made for PendulumSwingup-v0"):
        generate(DOUBLE_INTEGRATOR, tmp_path / "d", np.zeros((3, 2)), executor=executor)


def test_parameters_are_checked_before_anything_is_written(tmp_path):
    with pytest.raises(OutsideBoxError, match="extrapolate"):
        generate(PENDULUM, tmp_path / "d", np.array([[0.0, 9.0]]))
    with pytest.raises(ValueError, match="finite"):
        generate(PENDULUM, tmp_path / "d", np.array([[np.nan, 0.0]]))
    assert list(tmp_path.iterdir()) == []


# -- growth ------------------------------------------------------------------------------------------------------------


def grown(path, *sizes, executor=None):
    """A database that was made for the first of ``sizes`` instances and has grown to each of the others."""
    p = sample(PENDULUM, 7, sizes[-1])
    how = {"executor": executor or InProcess(), "seed": 3, "settings": SMALL}
    return [generate(PENDULUM, path, p[:size], **how) for size in sizes][-1]


@pytest.mark.parametrize("sizes", [(5, 12), (10, 15, 33), (25, 45)])
def test_a_database_grows_by_as_many_solves_as_there_are_new_instances(tmp_path, unguarded, sizes):
    *before, size = sizes
    first = grown(tmp_path / "d", *before)
    rows, executor = first.stored(slice(0, before[-1])), InProcess()
    database = grown(tmp_path / "d", size, executor=executor)
    assert sum(len(task.parameters) for task in executor.tasks) == size - before[-1]
    assert (len(database), database.complete) == (size, True)
    np.testing.assert_array_equal(database.parameters, sample(PENDULUM, 7, size))
    for name, value in vars(database.stored(slice(0, before[-1]))).items():
        np.testing.assert_array_equal(value, getattr(rows, name), err_msg=name)
    assert len(database.samples()) == size
    assert grown(tmp_path / "d", size, executor=Broken()).digest() == database.digest()  # nothing is left to solve


def test_growth_at_whole_chunks_equals_a_generation_in_the_same_order_of_rows(tmp_path, unguarded):
    database = grown(tmp_path / "grown", 20, 50, 60)
    p, settings = sample(PENDULUM, 7, 60), {"seed": 3, **SMALL.record()}
    order = np.argsort(database._row_of_index)
    Database.create(tmp_path / "once", PENDULUM, p, order=order, settings=settings, chunk=SMALL.chunk)
    assert grown(tmp_path / "once", 60).digest() == database.digest()
    assert Database.open(tmp_path / "once").key != database.key


def test_growth_depends_on_the_sizes_and_not_on_workers(tmp_path, unguarded):
    with ThreadPoolExecutor(2) as threads:
        digests = {grown(tmp_path / "threads", 15, 40, executor=threads).digest()}
    digests |= {grown(tmp_path / "alone", 15, 40).digest(), grown(tmp_path / "steps", 15, 20, 40).digest()}
    assert len(digests) == 2


def test_only_a_database_whose_parameters_are_the_first_of_the_given_grows(tmp_path, unguarded):
    path, p, how = tmp_path / "d", sample(PENDULUM, 7, 20), {"executor": InProcess(), "settings": SMALL}
    generate(PENDULUM, path, p[:10], **how)
    with pytest.raises(DatabaseError, match=r"holds 10 instances, of which the given 4 are the first; pass all"):
        generate(PENDULUM, path, p[:4], **how)
    with pytest.raises(DatabaseError, match=r"its 10 parameters are not the first .* grows where .* in the same order"):
        generate(PENDULUM, path, p[::-1], **how)
    unfinished = Database.create(tmp_path / "e", PENDULUM, p)
    with pytest.raises(DatabaseError, match="is not finished and cannot grow"):
        unfinished.grow(p[:1], [20])
    with pytest.raises(ValueError, match="permutation of 10 … 11"):
        Database.open(path).grow(p[:2], [0, 1])


# -- what is said ------------------------------------------------------------------------------------------------------

#: One guess for each winding, in chunks of 20.
QUICK = GenerationSettings(first=20, chunk=20, starts=1)


def test_where_progress_is_shown_a_probe_and_the_time_left_are_told(tmp_path, unguarded, capsys):
    p, how = sample(DOUBLE_INTEGRATOR, 7, 60), {"executor": InProcess(), "settings": QUICK}
    shown = generate(DOUBLE_INTEGRATOR, tmp_path / "shown", p, progress=True, **how)
    told = capsys.readouterr().err
    assert told.startswith("DoubleIntegrator-v0: probe of 5 instances: 5 SOLVED; ")
    assert re.search(r"; about \d+ s for 60 instances with \d+ workers", told)
    assert "DoubleIntegrator-v0: on 20 solutions intervals are accurate to " in told
    silent = generate(DOUBLE_INTEGRATOR, tmp_path / "silent", p, **how)
    assert capsys.readouterr().err == ""
    assert silent.digest() == shown.digest()  # a probe changes nothing


def test_substeps_that_are_too_few_are_told_once(tmp_path, unguarded):
    def damped(x, u, c):
        return [x[1], (u[0] - 15 * x[1]) / c.mass]

    system = dataclasses.replace(DOUBLE_INTEGRATOR.system, dynamics=damped)
    problem = dataclasses.replace(DOUBLE_INTEGRATOR, id="Damped-v0", system=system, duration=(1.9, 5.0), hold=0.0)
    p, how = np.array([[0.0, 1.0], [0.0, -1.0]]), {"executor": InProcess(), "settings": QUICK}
    with pytest.warns(UserWarning, match="Damped-v0: 1 Runge-Kutta substeps are too few") as told:
        generate(problem, tmp_path / "d", p, **how)
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        generate(problem, tmp_path / "d", p, **how)


def test_an_instance_that_no_trajectory_solves_has_a_status_of_its_own(tmp_path, unguarded):
    """From rest at 5 m, no force of 1 N leads to the origin within a second."""
    hasty = dataclasses.replace(DOUBLE_INTEGRATOR, id="Hasty-v0", duration=(0.2, 1.0))
    p = np.array([[0.1, 0.0], [5.0, 0.0]])
    database = generate(hasty, tmp_path / "d", p, executor=InProcess(), settings=QUICK)
    status = database.stored(slice(0, 2)).status[np.argsort(database.order)]
    assert status.tolist() == [Status.SOLVED, Status.INFEASIBLE]
