"""Generation on a real cluster: scheduler and workers in processes of their own, some of which are killed."""

import functools
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import ocp_envs
from moe_policy.experiments.interruptions import stored_chunks
from ocp_envs.data import generation
from ocp_envs.data.database import Database
from ocp_envs.data.generation import generate
from ocp_envs.data.settings import GenerationSettings
from ocp_envs.data.worker import solve_chunk
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.sets.splits import InstanceSet, ProblemSets
from ocp_envs.support.workers import TasksInFlight, Workers

distributed = pytest.importorskip("distributed")
ROOT = Path(__file__).resolve().parents[2]
SMALL = GenerationSettings(first=20, chunk=10, starts=2)
TINY = {"validation": InstanceSet(size=30, seed=202, settings=SMALL)}
COUNT = 80


@pytest.fixture(scope="module", autouse=True)
def _interpreted():
    """Workers inherit the environment: without a compiler their solvers start at once; and they find what we find."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", "")
        patch.setenv("PYTHONPATH", os.pathsep.join(entry or os.getcwd() for entry in sys.path))
        yield


def make(path, **how):
    return generate(PENDULUM, path, sample(PENDULUM, 7, COUNT), seed=3, settings=SMALL, **how)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole") / "d", workers=2)


@pytest.fixture(scope="module")
def cluster(_interpreted):
    local = functools.partial(distributed.LocalCluster, processes=True, dashboard_address=":0")
    with local(n_workers=3, threads_per_worker=1) as cluster:
        yield cluster


@pytest.fixture
def client(cluster):
    with distributed.Client(cluster) as client:
        client.wait_for_workers(3)
        yield client


@pytest.fixture
def meanwhile():
    """Calls functions in threads, and fails where they do."""
    threads, errors = [], []

    def call(function):
        def run():
            try:
                function()
            except BaseException as error:
                errors.append(error)

        threads.append(threading.Thread(target=run, daemon=True))
        threads[-1].start()

    yield call
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()
    assert errors == []


def wait_until(condition):
    deadline = time.monotonic() + 120
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


def test_a_killed_worker_changes_nothing(whole, client, meanwhile, tmp_path):
    path, pids = tmp_path / "d", client.run(os.getpid)
    assert len(set(pids.values())) == 3

    def kill():
        wait_until(lambda: len(stored_chunks(path)) >= 1)
        busy = wait_until(lambda: [address for address, keys in client.processing().items() if keys])
        os.kill(pids[busy[0]], signal.SIGKILL)

    meanwhile(kill)
    database = make(path, executor=client.get_executor())
    assert database.digest() == whole.digest()
    client.wait_for_workers(3, timeout=60)
    assert len(set(client.run(os.getpid).values()) - set(pids.values())) == 1  # it was killed, and replaced


def test_tasks_that_the_cluster_drops_are_submitted_again(whole, client, meanwhile, tmp_path):
    path = tmp_path / "d"

    def restart():
        wait_until(lambda: len(stored_chunks(path)) >= 1)
        client.restart()

    meanwhile(restart)
    assert make(path, executor=client.get_executor()).digest() == whole.digest()


def deadly(folder, times, task):
    """Chunk 0 kills its worker so many times."""
    killed = len(os.listdir(folder))
    if task.number == 0 and killed < times:
        (folder / str(killed)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return solve_chunk(task)


@pytest.mark.slow
def test_a_task_that_dask_gave_up_is_submitted_anew(whole, cluster, client, monkeypatch, tmp_path):
    """As another task: Dask hands back the failure of the first to one of the same name."""
    deaths, times = tmp_path / "deaths", cluster.scheduler.allowed_failures + 1
    deaths.mkdir()
    monkeypatch.setattr(generation, "solve_chunk", functools.partial(deadly, deaths, times))
    assert make(tmp_path / "d", executor=client.get_executor()).digest() == whole.digest()
    assert len(list(deaths.iterdir())) == times


def test_workers_may_join_later(whole, meanwhile, tmp_path):
    with (
        distributed.LocalCluster(n_workers=0, threads_per_worker=2, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        in_flight = TasksInFlight(client, look=0.0)
        with pytest.warns(UserWarning, match="no workers; waiting"):
            assert in_flight() == 2  # something must wait for the first worker

        def grow():
            wait_until(lambda: cluster.scheduler.tasks)
            cluster.scale(1)

        meanwhile(grow)
        with pytest.warns(UserWarning, match="no workers; waiting"):
            database = make(tmp_path / "d", executor=client.get_executor())
        assert in_flight() == 4  # two for each thread of the worker that came
    assert database.digest() == whole.digest()


def test_the_size_of_a_cluster_is_looked_up_now_and_then():
    class Client:
        status, scheduler, looks = "running", None, 0

        def ncores(self):
            self.looks += 1
            return {"tcp://one": 1, "tcp://two": 2}

    client = Client()
    in_flight = TasksInFlight(client, look=60.0)
    assert [in_flight() for _ in range(3)] == [6, 6, 6]
    assert client.looks == 1


def test_only_an_executor_of_dask_is_taken_for_one(client):
    assert distributed.KilledWorker not in Workers.of(ThreadPoolExecutor(1)).lost
    assert distributed.KilledWorker in Workers.of(client.get_executor()).lost


@pytest.mark.slow
def test_a_lost_scheduler_is_a_clear_error_and_the_same_call_goes_on(whole, meanwhile, tmp_path):
    path, host = tmp_path / "d", "tcp://127.0.0.1:28786"
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", host, "--no-dashboard"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", host, "--nthreads", "1", "--no-dashboard"]
    with subprocess.Popen(dask) as scheduler, subprocess.Popen(worker) as one:
        try:
            with distributed.Client(host, timeout=5) as client:
                client.wait_for_workers(1, timeout=60)

                def kill():
                    wait_until(lambda: len(stored_chunks(path)) >= 1)
                    scheduler.kill()

                meanwhile(kill)
                with pytest.raises(BrokenExecutor, match=f"scheduler {host} is gone.*the same call resumes"):
                    make(path, executor=client.get_executor())
        finally:
            scheduler.kill()
            one.terminate()
    assert 1 <= Database.open(path).present().sum() < 8
    assert make(path, workers=1).digest() == whole.digest()


# -- the script --------------------------------------------------------------------------------------------------------


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    monkeypatch.delitem(sys.modules, "generate_data", raising=False)
    module = importlib.import_module("generate_data")
    monkeypatch.setattr(module, "sets_of", lambda problem: ProblemSets(**TINY))
    return module


def test_the_script_generates_on_a_cluster(script, cluster, monkeypatch, tmp_path, capsys):
    address = cluster.scheduler_address
    folders = [f"--data={tmp_path}", f"--results={tmp_path}"]
    monkeypatch.setattr(sys, "argv", ["generate_data", *folders, "--splits", "validation", "--scheduler", address])
    script.main()
    assert f"3 workers with 3 threads at {address}" in capsys.readouterr().out
    split, path = TINY["validation"], tmp_path / PENDULUM.id / "validation.zarr"
    p = split.parameters(PENDULUM)
    here = generate(PENDULUM, tmp_path / "here", p, workers=1, seed=split.seed, settings=SMALL)
    assert ocp_envs.Database.open(path).digest() == here.digest()
    np.testing.assert_array_equal(here.parameters, p)


class OldWorkers:
    """A client whose workers have something else installed."""

    def __init__(self, address, timeout):
        pass

    def wait_for_workers(self, count, timeout):
        pass

    def run(self, function, package):
        return {"tcp://here:1": function(package), "tcp://there:2": "0.1" if package == "casadi" else function(package)}

    def close(self):
        pass


def test_the_script_says_what_is_missing(script, monkeypatch):
    monkeypatch.setattr(script, "CONNECT_LIMIT", 1)
    with pytest.raises(SystemExit, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        script.connect("tcp://127.0.0.1:9")
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0") as empty:
        monkeypatch.setattr(script, "WORKER_LIMIT", 0.2)
        with pytest.raises(SystemExit, match=f"has no workers; start some with `dask worker {empty.scheduler_address}"):
            script.connect(empty.scheduler_address)
    monkeypatch.setattr(distributed, "Client", OldWorkers)
    with pytest.raises(SystemExit, match=r"there:2 has casadi 0\.1.*install the same version everywhere"):
        script.connect("tcp://host:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit, match=r"distributed is missing.*\[cluster\]"):
        script.connect("tcp://host:1")
