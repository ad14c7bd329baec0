"""Ctrl-C, and the signal by which other programs end one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Seconds that the end of a script may take, which is 2 on a machine that does nothing else.
LIMIT = 10


def of_session(leader):
    """Processes in the session that ``leader`` began, other than those that have ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session = path.read_text().rsplit(")", 1)[1].split()[:4]
        except OSError:  # it has just ended
            continue
        if int(session) == leader and state != "Z":
            found.append(int(path.parent.name))
    return found


@pytest.fixture
def interrupted(tmp_path):
    """Interrupts a script when it has written a line; its status, what it told, and the processes it left behind."""

    def call(number, script, *arguments):
        process = subprocess.Popen(
            [sys.executable, str(ROOT / "scripts" / script), *arguments, "--results", str(tmp_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        )
        assert process.stdout.readline()
        time.sleep(1)  # into the work, or the start of the workers
        os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        _, told = process.communicate(timeout=LIMIT)
        deadline = time.monotonic() + LIMIT
        while (left := of_session(process.pid)) and time.monotonic() < deadline:
            time.sleep(0.05)
        return process.returncode, told, left

    return call


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_generation_says_that_the_same_command_continues(number, status, interrupted, tmp_path):
    ended = interrupted(number, "generate_data.py", "--data", str(tmp_path), "--workers", "2")
    assert ended == (status, "generate_data.py: interrupted; the same command continues\n", [])


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_a_benchmark_begins_again(interrupted):
    assert interrupted(signal.SIGINT, "benchmark_env.py") == (130, "benchmark_env.py: interrupted\n", [])
