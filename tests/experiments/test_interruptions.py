"""Kills of a generation: when they are planned, and which chunks count as written again."""

import os
import sys

import numpy as np
import pytest

from moe_policy.experiments.interruptions import Kill, _Rewritten, generate_interrupted, plan_kills, stored_chunks


def test_kills_are_planned_in_order_within_the_generation_and_by_seed():
    kinds = ["parent"] * 3 + ["worker"] * 2
    kills = plan_kills(kinds, chunks=50, delay=2.0, seed=1)
    assert sorted(kill.kind for kill in kills) == kinds
    assert (np.diff([kill.chunks for kill in kills]) >= 0).all()
    assert all(0 <= kill.chunks < 40 and 0 <= kill.delay <= 2.0 for kill in kills)
    assert plan_kills(kinds, chunks=50, delay=2.0, seed=1) == kills
    assert plan_kills(kinds, chunks=50, delay=2.0, seed=2) != kills


def test_chunks_that_are_written_again_are_counted(tmp_path):
    folder = tmp_path / "status" / "c"
    folder.mkdir(parents=True)
    rewritten = _Rewritten(tmp_path)
    assert rewritten.look() == 0
    for name in ("0", "1", "zarr.json"):
        (folder / name).write_text("")
    assert set(stored_chunks(tmp_path)) == {0, 1}
    assert (rewritten.look(), rewritten.count) == (2, 0)
    (folder / "2").write_text("")
    assert (rewritten.look(), rewritten.count) == (3, 0)
    changed = folder / "1"
    stat = changed.stat()

    os.utime(changed, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1_000_000))
    (folder / "0").unlink()
    assert (rewritten.look(), rewritten.count) == (2, 2)


#: Starts a process that ends with this one or after a minute, as the first argument says, and waits.
PARENT = """
import subprocess, sys, time
child = {"ends": "import sys; sys.stdin.read()", "stays": "import time; time.sleep(60)"}[sys.argv[1]]
subprocess.Popen([sys.executable, "-c", child], stdin=subprocess.PIPE)
time.sleep(float(sys.argv[2]))
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="finds processes in /proc")
@pytest.mark.parametrize("child", ["ends", "stays"])
def test_a_process_that_outlives_a_killed_one_is_an_error(tmp_path, monkeypatch, child):
    monkeypatch.setattr("moe_policy.experiments.interruptions._Started.left.__defaults__", (0.5,))
    command, kills = [sys.executable, "-c", PARENT, child, "1"], [Kill("parent", 0, 0.5)]
    if child == "ends":
        assert generate_interrupted(command, tmp_path, kills).starts == 2
        return
    with pytest.raises(RuntimeError, match="processes outlived the one that started them") as caught:
        generate_interrupted(command, tmp_path, kills)
    for process in map(int, str(caught.value).split("[")[1].rstrip("]").split(",")):
        os.kill(process, 9)
