import os
import signal
import sys
import time
from types import SimpleNamespace

import pytest

from ocp_envs.support import pool as pool_module
from ocp_envs.support.pool import WorkerLostError, WorkerPool, _Worker, import_in_workers


def nap(seconds, path=None):
    if path is not None:
        path.write_text(str(os.getpid()))
    time.sleep(seconds)
    return os.getpid()


def fail():
    raise FloatingPointError("inside")


def closure():
    return lambda: None


def read_when_there(path):
    deadline = time.monotonic() + 60
    while not (path.exists() and path.read_text()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return int(path.read_text())


@pytest.fixture(scope="module")
def pool():
    with WorkerPool(2) as pool:
        yield pool


def test_tasks_run_in_other_processes_side_by_side(pool):
    pids = {future.result() for future in [pool.submit(nap, 0.5) for _ in range(2)]}
    assert len(pids) == 2
    assert os.getpid() not in pids


def test_exceptions_come_back_with_where_they_arose(pool):
    error = pool.submit(fail).exception()
    assert isinstance(error, FloatingPointError)
    assert "in fail" in error.__notes__[0]


def test_what_cannot_be_sent_is_an_error_and_the_worker_goes_on(pool):
    with pytest.raises(TypeError, match="cannot leave its worker"):
        pool.submit(closure).result()
    with pytest.raises((AttributeError, TypeError)):
        pool.submit(lambda: None).result()
    assert pool.submit(abs, -3).result() == 3


def test_a_killed_worker_costs_its_own_task_only(pool, tmp_path):
    doomed, other = pool.submit(nap, 60, tmp_path / "pid"), pool.submit(nap, 1.0)
    os.kill(read_when_there(tmp_path / "pid"), signal.SIGKILL)
    with pytest.raises(WorkerLostError, match="exit code -9"):
        doomed.result(timeout=30)
    assert other.exception(timeout=30) is None
    assert [pool.submit(abs, n).result(timeout=30) for n in range(4)] == [0, 1, 2, 3]  # it was replaced


def test_a_worker_killed_while_it_sends_its_result_is_noticed(monkeypatch):
    """Half a result has come; the standard library's pool waits for the rest for ever."""
    worker = _Worker()
    pipe = worker._connection

    def send(message):
        pipe.send(message)
        assert pipe.poll(60)
        worker.kill()

    monkeypatch.setattr(worker, "_connection", SimpleNamespace(send=send, recv=pipe.recv, close=pipe.close))
    with pytest.raises(WorkerLostError, match="exit code -9"):
        worker.call((bytes, (50_000_000,), {}))


def test_a_shutdown_without_waiting_ends_tasks_and_processes(tmp_path):
    pool = WorkerPool(1)
    running, waiting = pool.submit(nap, 60, tmp_path / "pid"), pool.submit(nap, 60)
    pid = read_when_there(tmp_path / "pid")
    began = time.monotonic()
    pool.shutdown(wait=False)
    assert time.monotonic() - began < 30
    assert isinstance(running.exception(), WorkerLostError)
    assert waiting.cancelled()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_block_that_fails_or_is_interrupted_does_not_wait_for_its_tasks(tmp_path):
    def interrupted():
        with WorkerPool(1) as pool:
            pool.submit(nap, 60, tmp_path / "began")
            read_when_there(tmp_path / "began")
            raise KeyboardInterrupt

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began < 30


def imported(name):
    return name in sys.modules


def test_workers_import_the_modules_that_the_program_asks_for(monkeypatch, tmp_path):
    (tmp_path / "registers_something.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(pool_module, "_IMPORTED", [])
    import_in_workers("registers_something")
    with WorkerPool(1) as pool:
        assert pool.submit(imported, "registers_something").result()
    assert not imported("registers_something")


@pytest.mark.parametrize("workers", [0, -2])
def test_a_pool_without_workers_is_refused(workers):
    with pytest.raises(ValueError, match="expected at least 1, or None for one per core"):
        WorkerPool(workers)
