"""Kills of a generation: when they are planned, and which chunks count as written again."""

import os

import numpy as np

from moe_policy.experiments.interruptions import _Rewritten, plan_kills, stored_chunks


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
