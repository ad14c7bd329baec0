"""How a script runs and ends."""

import io
import subprocess
import sys
from pathlib import Path

import pytest

from moe_policy.experiments import running
from ocp_envs.data.layout import DatabaseError
from ocp_envs.problems import UnknownProblemError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def end(monkeypatch, capsys):
    """The exit status of a script whose main is a function, and what it writes to standard error."""
    monkeypatch.setattr(running.progress, "show", lambda shown: None)
    monkeypatch.setattr(running.signal, "signal", lambda number, handler: None)
    monkeypatch.setattr(sys, "argv", ["/somewhere/script.py"])

    def call(main, **options):
        with pytest.raises(SystemExit) as end:
            running.run(main, **options)
        return end.value.code, capsys.readouterr().err

    return call


def failing(error):
    def main():
        raise error

    return main


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (DatabaseError("x.zarr is damaged: cost"), 1, "x.zarr is damaged: cost"),
        (UnknownProblemError("unknown problem 'Pendulum'"), 1, "unknown problem 'Pendulum'"),
        (running.UsageError("--cases: got 5, there are 3"), 2, "--cases: got 5, there are 3"),
        (SystemExit("no Dask scheduler answers"), 1, "no Dask scheduler answers"),
        (PermissionError(13, "Permission denied", "/results/x.json"), 1, "/results/x.json: Permission denied"),
        (OSError(28, "No space left on device"), 1, "No space left on device"),
        (running.RecordError("a.json is not a Record:\n  rows: got 3\n"), 1, "a.json is not a Record:; rows: got 3"),
        (ModuleNotFoundError("No module named 'PIL'", name="PIL.Image"), 1, running.install("PIL")),
    ],
)
def test_errors_of_input_and_machine_are_one_line(error, status, words, end):
    assert end(failing(error)) == (status, f"script.py: error: {words}\n")


@pytest.mark.parametrize(
    "error", [ValueError("x"), AssertionError(), TypeError("x"), ModuleNotFoundError("x", name="moe_policy.nothing")]
)
def test_faults_of_the_program_keep_their_traceback(error, monkeypatch):
    monkeypatch.setattr(running.progress, "show", lambda shown: None)
    monkeypatch.setattr(running.signal, "signal", lambda number, handler: None)
    with pytest.raises(type(error)):
        running.run(failing(error))


def test_a_script_ends_with_the_status_of_its_main(end):
    assert end(lambda: 3) == (3, "")
    assert end(lambda: None) == (None, "")


@pytest.mark.parametrize(
    ("continues", "words"), [(True, "interrupted; the same command continues"), (False, "interrupted")]
)
def test_an_interrupt_is_one_line(continues, words, end):
    assert end(failing(KeyboardInterrupt()), continues=continues) == (130, f"script.py: {words}\n")


def test_experiments_without_their_packages_end_in_one_line_before_any_work():
    code = "import sys; sys.modules['PIL'] = None; import moe_policy.experiments"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (1, f"error: {running.install('PIL')}\n")


def test_an_option_names_itself_in_the_errors_of_its_value():
    with pytest.raises(running.UsageError, match=r"^--set: expected gamma in"), running.option("--set"):
        raise ValueError("expected gamma in (0, 1]")


def test_greek_letters_do_not_end_a_script_on_a_console_without_them(end, monkeypatch):
    console = io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    monkeypatch.setattr(sys, "stdout", console)
    assert end(lambda: print("r = 0.1, ρ = 1")) == (None, "")
    assert console.buffer.getvalue() == b"r = 0.1, ? = 1\n"
