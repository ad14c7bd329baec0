"""Progress: a bar on a terminal, elsewhere a line a minute."""

import io
import sys
import time

import pytest

from ocp_envs.support import progress
from ocp_envs.support.progress import Expectation, Progress, track


@pytest.fixture
def on_terminal(monkeypatch):
    """What a function writes to a terminal."""

    def call(function):
        made = io.StringIO()
        made.isatty = lambda: True
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", made)
            function()
        return made.getvalue()

    return call


@pytest.fixture(autouse=True)
def _default(monkeypatch):
    monkeypatch.setattr(progress, "_shown", None)


def work(seconds=0.0, pieces=4, **options):
    """Do ``pieces`` of work in ``seconds``."""
    with Progress(pieces, unit="instance", label="pendulum", **options) as bar:
        for failed in range(pieces):
            time.sleep(seconds / pieces)
            bar.update(failed=failed)


@pytest.fixture
def minute(monkeypatch):
    """The time between two lines, in seconds."""
    monkeypatch.setattr(progress, "INTERVAL", 0.05)
    return 0.05


def test_short_work_is_silent_without_a_terminal(capsys):
    work(shown=True)
    assert capsys.readouterr().err == ""


def test_longer_work_is_told_in_a_line_a_minute_and_a_last_one(minute, capsys):
    work(8 * minute, shown=True)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 9
    assert all(line.startswith("pendulum: ") for line in lines)
    assert lines[-1].startswith("pendulum: 4 of 4 instances, ")
    assert lines[-1].endswith(" left, failed 3")


def test_a_piece_that_takes_minutes_is_told_as_well(minute, capsys):
    work(4 * minute, pieces=1, shown=True)
    assert "pendulum: 0 of 1 instances, " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("done", "elapsed", "initial", "words"),
    [
        (0, 60, 0, "0 of 1,000 instances, 1 min so far"),
        (3, 60, 0, "3 of 1,000 instances, 1 min so far, 20 s per instance, 5 h 32 min left"),
        (600, 100, 400, "600 of 1,000 instances, 2 min so far, 2 instances/s, 3 min left"),
    ],
)
def test_progress_in_words_has_the_rate_of_this_run_and_the_time_left(done, elapsed, initial, words):
    assert progress.describe(done, 1_000, "instance", elapsed, initial) == words


@pytest.mark.parametrize("shown", [None, False])
def test_a_library_is_silent_without_a_terminal(shown, minute, capsys):
    work(4 * minute, shown=shown)
    assert capsys.readouterr().err == ""


def test_a_program_asks_for_lines_once(minute, capsys):
    progress.show(True)
    work(4 * minute, shown=False)
    assert capsys.readouterr().err == ""
    work(4 * minute)
    assert "pendulum: 4 of 4" in capsys.readouterr().err


@pytest.mark.parametrize("shown", [None, True])
def test_a_terminal_has_a_bar(shown, on_terminal):
    shows = on_terminal(lambda: work(shown=shown))
    assert "pendulum: 100%" in shows
    assert "4/4" in shows


def test_a_terminal_stays_empty_where_nothing_is_shown(on_terminal):
    assert on_terminal(lambda: work(shown=False)) == ""


def test_items_count_when_the_next_one_is_asked_for(on_terminal):
    counts = []

    def shown():
        for item in track(range(4), 4, unit="run", label="margins"):
            counts.append(item)

    assert "margins: 100%" in on_terminal(shown)
    assert counts == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0 s"), (59, "59 s"), (60, "1 min"), (3500, "58 min"), (7500, "2 h 05 min")]
)
def test_durations_are_words(seconds, words):
    assert progress.duration(seconds) == words


@pytest.mark.parametrize(
    ("per_second", "words"),
    [(1234.5, "1,234 runs/s"), (2.5, "2.5 runs/s"), (20.0, "20 runs/s"), (0.025, "40 s per run")],
)
def test_rates_are_words(per_second, words):
    assert progress.rate(per_second, "run") == words


#: Ten pieces of ten seconds, then pieces of one second, on two workers.
SLOW_FIRST = Expectation(lambda n: 10.0 * min(n, 10) + max(n - 10, 0), workers=2)


@pytest.mark.parametrize(
    ("done", "initial", "elapsed", "left"),
    [(0, 0, 0.0, 95.0), (5, 0, 25.0, 70.0), (10, 0, 100.0, 90.0), (55, 10, 45.0, 45.0)],
    ids=["before the first piece", "as expected", "twice as slow as expected", "continued"],
)
def test_the_time_left_follows_what_pieces_are_expected_to_take(done, initial, elapsed, left):
    assert SLOW_FIRST.left(done, 100, initial, elapsed) == pytest.approx(left)
    assert progress.describe(done, 100, "instance", elapsed, initial, SLOW_FIRST).endswith(
        f"{progress.duration(left)} left"
    )


def test_a_bar_tells_the_time_left_among_the_facts(on_terminal):
    def call():
        with Progress(100, unit="instance", label="pendulum") as bar:
            assert bar.shown
            bar.say("a line")
            bar.expect(SLOW_FIRST)
            bar.update(50, failed=3)

    told = on_terminal(call)
    assert "a line" in told
    assert "failed=3, left=" in told


def test_where_progress_is_hidden_nothing_is_said(capsys):
    with Progress(1, unit="instance", label="pendulum") as bar:
        assert not bar.shown
        bar.say("a line")
    assert capsys.readouterr().err == ""
