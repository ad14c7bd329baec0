"""Every exported callable, and each method that takes data of a user, with strange arguments: told in words at once."""

from __future__ import annotations

import contextlib
import dis
import importlib.util
import inspect
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import moe_policy
import ocp_envs
from ocp_envs import problems
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.support.rows import Batch
from tests.door_calls import Door, doors
from tests.door_values import use_folder
from tests.method_calls import methods
from tests.strangeness import CHANGES, STRANGE, may_fit

resource = pytest.importorskip("resource", reason="the memory of a call is limited on Unix alone")
ROOT = Path(__file__).resolve().parents[1]
STRANGENESS = str(ROOT / "tests" / "strangeness.py")
#: Seconds after which a call hangs, and bytes that it may allocate.
PATIENCE, MEMORY = 20, 3 * 2**30
#: Optional packages that doors need.
NEEDS = {"train": ("stable_baselines3",)} | dict.fromkeys(
    ("export_minari", "read_minari", "resimulate"), ("minari", "h5py")
)


def _can_be_called(door: Door) -> bool:
    return all(importlib.util.find_spec(name) for name in NEEDS.get(door.short, ()))


DOORS = list(doors())
EVERYTHING = [*filter(_can_be_called, DOORS), *methods()]
#: What a call of a path that is not there may end in, wherever it is raised.
FILES = (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError)


class Hangs(BaseException):
    """A call takes too long."""


@dataclass
class Count:
    """How calls ended, by door."""

    calls: Counter[str] = field(default_factory=Counter)
    accepted: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    hanging: list[str] = field(default_factory=list)

    def __iadd__(self, other: Count) -> Count:
        self.calls += other.calls
        self.accepted += other.accepted
        self.foreign += other.foreign
        self.hanging += other.hanging
        return self

    def __str__(self) -> str:
        total = sum(self.calls.values())
        text = f"{total} calls, {len(self.accepted)} accepted, {len(self.foreign)} foreign, {len(self.hanging)} hanging"
        return "\n".join([text, *sorted(self.accepted), *sorted(self.foreign), *self.hanging])


def _is_ours(frame: traceback.FrameSummary | Any) -> bool:
    file = frame.f_code.co_filename
    return file.startswith((str(ROOT / "ocp_envs"), str(ROOT / "moe_policy")))


def told(error: BaseException) -> bool:
    """Whether a check of the library raised ``error``, or Python itself because of missing and unknown arguments."""
    if isinstance(error, FILES):
        return True  # a path that is not there, wherever it is noticed
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    if last is None or last.tb_frame.f_code.co_filename in (__file__, "<string>"):
        return isinstance(error, TypeError)
    if last.tb_frame.f_code.co_filename == STRANGENESS:
        return True  # the function that was given
    raises = last.tb_frame.f_code.co_code[last.tb_lasti] == dis.opmap["RAISE_VARARGS"]
    return _is_ours(last.tb_frame) and raises


def _alarm(*_: object) -> None:
    raise Hangs


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """Time and memory are bounded, and problems that are registered inside are forgotten."""
    known, before = set(problems._catalogue), resource.getrlimit(resource.RLIMIT_AS)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    old = signal.signal(signal.SIGALRM, _alarm)
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, before[1]))
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.signal(signal.SIGALRM, old)
        for name in set(problems._catalogue) - known:
            del problems._catalogue[name], gym.registry[name]


def call(door: Door, arguments: dict[str, Any], fits: bool, text: str, count: Count) -> None:
    """Call ``door`` with ``arguments``, and note how it ends."""
    count.calls[door.name] += 1
    try:
        with warnings.catch_warnings(), bounded():
            warnings.simplefilter("ignore")
            door.value(**arguments)
    except Hangs:
        count.hanging.append(text)
    except Exception as error:
        if not told(error):
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(last.filename).name}:{last.lineno}"
            count.foreign.append(f"{text}: {type(error).__name__} {str(error)[:80]!r} at {where}")
    else:
        if not fits:
            count.accepted.append(text)


@st.composite
def strange_calls(draw: st.DrawFn, door: Door) -> tuple[dict[str, Any], bool, str]:
    """Arguments of ``door`` of which one is strange, whether they may fit, and what is strange."""
    arguments, parameters = door.arguments(), door.signature.parameters
    name = draw(st.sampled_from([each for each, p in parameters.items() if p.kind not in (2, 4)] or [""]))
    if not name:
        return arguments | {"unknown": 1}, False, f"{door.name}(unknown=1)"
    fitting = arguments.get(name, parameters[name].default)
    changes = [each for each, (applies, _) in CHANGES.items() if applies(fitting)]
    kind = draw(st.sampled_from([*changes, *STRANGE]))
    value = CHANGES[kind][1](fitting) if kind in changes else STRANGE[kind]()
    fits = may_fit(str(parameters[name].annotation), value)
    rows = [each for each in arguments.values() if hasattr(each, "shape") or isinstance(each, Batch)]
    if inspect.isclass(door.value) and issubclass(door.value, Batch) and kind == "one row less" and len(rows) > 1:
        fits = False
    return arguments | {name: value}, fits, f"{door.name}({name}={kind})"


def fuzz(door: Door, examples: int) -> Count:
    """Strange calls of ``door``."""
    count = Count()

    @settings(
        max_examples=examples, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
    )
    @given(strange_calls(door))
    def run(drawn: tuple[dict[str, Any], bool, str]) -> None:
        call(door, *drawn, count)

    run()
    return count


@pytest.fixture(autouse=True, scope="module")
def folder(tmp_path_factory):
    """Whatever is written is in a temporary folder, relative paths and Minari's datasets included."""
    path = tmp_path_factory.mktemp("doors")
    use_folder(path)
    with contextlib.chdir(path), pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(path / "minari"))
        (path / "minari").mkdir()
        yield


@pytest.mark.parametrize("door", EVERYTHING, ids=lambda door: door.name)
def test_what_does_not_fit_is_refused_at_the_door(door):
    door.value(**door.arguments())
    count = fuzz(door, 2)
    assert not count.accepted + count.foreign + count.hanging, str(count)


@pytest.mark.slow
def test_ten_thousand_strange_calls():
    """None is accepted in silence or hangs, and hardly any ends in an error of another library."""
    count = Count()
    for door in EVERYTHING:
        count += fuzz(door, 100)
    assert sum(count.calls.values()) >= 10_000
    assert not count.accepted + count.hanging, str(count)
    assert len(count.foreign) < 0.01 * sum(count.calls.values()), str(count)


@pytest.mark.parametrize("package", [ocp_envs, moe_policy], ids=lambda package: package.__name__)
def test_every_function_and_class_that_can_be_called_is_a_door(package):
    names = {door.short for door in DOORS if door.name.startswith(package.__name__)}
    values = {name: getattr(package, name) for name in package.__all__}
    assert names >= {
        name
        for name, value in values.items()
        if inspect.isfunction(value) or (inspect.isclass(value) and is_dataclass(value))
    }


NAMED = [door for door in EVERYTHING if "ProblemOrId" in str(door.signature)]


@pytest.mark.parametrize("door", NAMED, ids=lambda door: door.name)
def test_a_problem_may_be_given_by_its_name(door, monkeypatch):
    arguments = door.arguments()
    problem = arguments.get("problem", PENDULUM)
    monkeypatch.setitem(problems._catalogue, problem.id, problem)
    door.value(**arguments | {"problem": problem.id})


def test_only_values_and_the_catalogue_want_the_problem_itself():
    parameters = {door: door.signature.parameters for door in DOORS if "problem" in door.signature.parameters}
    itself = {door for door, found in parameters.items() if "ProblemOrId" not in str(found["problem"].annotation)}
    # What a problem derives of itself is made by the problem, not by its name.
    derived = {"BatchFunctions", "Formulation", "Horizon", "TerminalSet"}
    assert {door.short for door in itself if not is_dataclass(door.value)} == {"register"} | derived
