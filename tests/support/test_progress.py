"""Progress: a bar on a terminal, elsewhere a line a minute."""

import io
import sys

import pytest

from ocp_envs.support import progress
from ocp_envs.support.progress import Progress, track


class Clock:
    """A clock that a test sets."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(progress, "time", made)
    return made


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


def work(clock, seconds, pieces=10, **options):
    """Do ``pieces`` of work in ``seconds``."""
    with Progress(pieces, unit="instance", label="pendulum", **options) as bar:
        for failed in range(pieces):
            clock.now += seconds / pieces
            bar.update(failed=failed)


def test_work_of_less_than_a_minute_is_silent_without_a_terminal(clock, capsys):
    work(clock, 59, shown=True)
    assert capsys.readouterr().err == ""


def test_longer_work_is_told_in_a_line_a_minute_and_a_last_one(clock, capsys):
    work(clock, 200, shown=True)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "pendulum: 3 of 10 instances, 1 min so far, 20 s per instance, 2 min left, failed 2"
    assert [line.split()[1] for line in lines] == ["3", "6", "9", "10"]


def test_the_rate_is_that_of_this_run(clock, capsys):
    with Progress(1_000, unit="instance", label="pendulum", initial=400, shown=True) as bar:
        clock.now += 100
        bar.update(200)
    told = "pendulum: 600 of 1,000 instances, 2 min so far, 2 instances/s, 3 min left\n"
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("shown", [None, False])
def test_a_library_is_silent_without_a_terminal(shown, clock, capsys):
    work(clock, 200, shown=shown)
    assert capsys.readouterr().err == ""


def test_a_program_asks_for_lines_once(clock, capsys):
    progress.show(True)
    work(clock, 200)
    work(clock, 200, shown=False)
    assert len(capsys.readouterr().err.splitlines()) == 4


@pytest.mark.parametrize("shown", [None, True])
def test_a_terminal_has_a_bar(shown, clock, on_terminal):
    shows = on_terminal(lambda: work(clock, 1, shown=shown))
    assert "pendulum: 100%" in shows
    assert "10/10" in shows


def test_a_terminal_stays_empty_where_nothing_is_shown(clock, on_terminal):
    assert on_terminal(lambda: work(clock, 200, shown=False)) == ""


def test_items_count_when_the_next_one_is_asked_for(clock, capsys):
    for _ in track(range(4), 4, unit="run", label="margins", shown=True):
        clock.now += 45
    assert [line.split()[1] for line in capsys.readouterr().err.splitlines()] == ["2", "4"]


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
