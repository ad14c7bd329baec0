"""Policies as C: compiled, called from Python, and compared with the policy that they were written from."""

from __future__ import annotations

import ctypes
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import Record
from ocp_envs.support.arrays import Array, address
from ocp_envs.support.clock import count_steps
from ocp_envs.support.compiler import find_compiler
from ocp_envs.support.programs import entry
from ocp_envs.support.provenance import Provenance

#: Any compiler of C99, any processor.
FLAGS = ("-std=c99", "-O3")
_TIMES = Path(__file__).with_name("exported.c")
#: Random states from which control steps are compared and timed.
_SEED = 707


@dataclass(frozen=True, kw_only=True)
class Times(Record):
    """Seconds for a plan, for the regulators along it, and for a control step, of one row."""

    plan: float
    regulators: float
    step: float


@dataclass(frozen=True, kw_only=True)
class ExportRow(Record):
    """Size and speed of one policy in C, and in Python in the same run.

    Bytes of the source, of the stripped library and of the state of an episode. Differences: of the plans, in standard
    deviations of their values, which is the rounding of single precision; and of the controls along equal plans, in
    ranges of the controls.
    """

    env_id: str
    planner: str
    weights: int
    source_bytes: int
    library_bytes: int
    state_bytes: int
    in_c: Times
    in_python: Times
    predict_seconds: float
    plan_difference: float
    control_difference: float


@dataclass(frozen=True, kw_only=True)
class Exports(Record):
    """Policies in C; the ``flags`` of the compiler."""

    dt: float
    flags: tuple[str, ...]
    rows: tuple[ExportRow, ...]
    provenance: Provenance


class Exported:
    """A policy in C, as a library, with the memory of the state of one episode.

    Args:
        policy: the policy in Python.
        folder: where files are written.
        flags: those of the compiler.

    Raises:
        RuntimeError: there is no C compiler.
    """

    def __init__(self, policy: TrackingPolicy, folder: Path, flags: tuple[str, ...] = FLAGS) -> None:
        compiler, problem = find_compiler(), policy.problem
        if compiler is None:
            raise RuntimeError("no C compiler found (cc, gcc or clang; set CC to name another)")
        self.source = policy.to_c(folder)
        self.path = self.source.with_suffix(".so")
        files = ["-I", str(folder), str(self.source), str(_TIMES), "-o", str(self.path)]
        subprocess.run([compiler, *flags, "-s", "-shared", "-fPIC", *files, "-lm"], check=True)
        library = ctypes.CDLL(str(self.path))
        self._plan, self._follow, self._start, self._act, self._seconds = (
            entry(library, name, arguments)
            for name, arguments in (
                ("policy_plan", "pp"),
                ("policy_follow", "ppp"),
                ("policy_start", "pp"),
                ("policy_act", "ppp"),
                ("seconds", "qqppp"),
            )
        )
        nx, nu, length = problem.system.nx, problem.system.nu, int(count_steps(problem.horizon.longest, policy.dt)) + 1
        arrays = {"states": (nx,), "controls": (nu,), "gains": (nu, nx), "norms": (nu, nu)}
        fields = [(name, np.float64, (length, *shape)) for name, shape in arrays.items()]
        numbers = [("steps", np.int64), ("clock", np.int64), ("clipped", np.int32), ("rejected", np.int32)]
        self.state = np.zeros((), np.dtype([*fields, *numbers], align=True))
        self._flat_size, self._nu = problem.flat_size, nu

    def plan(self, p: ArrayLike) -> Array:
        """The network's plan in the flat layout, (flat_size,), for parameters ``p`` (np,)."""
        given, plan = np.array(p, np.float64), np.empty(self._flat_size)
        self._plan(address(given), address(plan))
        return plan

    def follow(self, plan: ArrayLike, p: ArrayLike) -> None:
        """Begin to track ``plan`` (flat_size,) for parameters ``p`` (np,)."""
        flat, given = np.array(plan, np.float64), np.array(p, np.float64)
        self._follow(address(self.state), address(flat), address(given))

    def start(self, p: ArrayLike) -> None:
        """Plan for parameters ``p`` (np,), and begin to track the plan."""
        given = np.array(p, np.float64)
        self._start(address(self.state), address(given))

    def act(self, observation: ArrayLike) -> Array:
        """The control (nu,) at an ``observation`` (nx + nc,)."""
        seen, control = np.array(observation, np.float64), np.empty(self._nu)
        self._act(address(self.state), address(seen), address(control))
        return control

    def times(self, p: Array, observations: Array, calls: int) -> Times:
        """Means over ``calls`` plans for ``p`` (n, np), and control steps at ``observations`` (n, nx + nc)."""
        taken = np.empty(3)
        self._seconds(calls, len(p), address(p), address(observations), address(taken))
        return Times(plan=float(taken[0]), regulators=float(taken[1]), step=float(taken[2]))


def export_row(policy: TrackingPolicy, p: Array, calls: int, rounds: int) -> ExportRow:
    """Size and speed of ``policy`` for parameters ``p`` (n, np), n ≥ 1: medians over ``rounds`` of ``calls`` plans."""
    problem, planner = policy.problem, policy.planner
    assert isinstance(planner, NetworkPlanner), "others are not exported"
    states = problem.system.state.draw(np.random.default_rng(_SEED), len(p))
    observations = np.concatenate([states, problem.start(p)[1]], axis=1)
    with TemporaryDirectory() as folder:
        exported = Exported(policy, Path(folder))
        both = [
            (exported.times(p, observations, calls), _in_python(policy, p, observations, calls)) for _ in range(rounds)
        ]
        plans = np.array([exported.plan(row) for row in p])
        return ExportRow(
            env_id=problem.id,
            planner=planner.name,
            weights=planner.parameters_total,
            source_bytes=exported.source.stat().st_size,
            library_bytes=exported.path.stat().st_size,
            state_bytes=exported.state.nbytes,
            in_c=_median([c for c, _ in both]),
            in_python=_median([times for _, (times, _) in both]),
            predict_seconds=float(np.median([predict for _, (_, predict) in both])),
            plan_difference=float(np.abs((plans - planner(p).flat()) / planner.outputs.std).max()),
            control_difference=max(_difference(policy, exported, *each) for each in zip(p, observations)),
        )


def _median(times: list[Times]) -> Times:
    plan, regulators, step = (float(np.median([getattr(t, name) for t in times])) for name in Times.__annotations__)
    return Times(plan=plan, regulators=regulators, step=step)


def _in_python(policy: TrackingPolicy, p: Array, observations: Array, calls: int) -> tuple[Times, float]:
    """The same in Python, and seconds of a control step of ``predict``, after those that are watched."""
    contexts, none = policy.problem.start(p)[1], np.zeros(1, bool)
    plans = [policy.planner(row[None]) for row in p]
    state = watched = policy.follow(plans[0], contexts[:1])
    rows = [observations[i : i + 1] for i in range(len(p))]

    def act(i: int) -> None:
        nonlocal state
        _, state = policy.act(rows[i], state, none)

    def predict(i: int) -> None:
        nonlocal watched
        _, watched = policy.predict(rows[i], watched, none)

    times = Times(
        plan=_mean(lambda i: policy.planner(p[i : i + 1]), len(p), calls),
        regulators=_mean(lambda i: policy.follow(plans[i], contexts[i : i + 1]), len(p), calls),
        step=_mean(act, len(p), 10 * calls),
    )
    return times, _mean(predict, len(p), 10 * calls)


def _mean(call: Callable[[int], object], count: int, calls: int) -> float:
    """Mean seconds of ``calls`` calls, whose argument is one of ``count`` numbers in turn."""
    began = time.perf_counter()
    for i in range(calls):
        call(i % count)
    return (time.perf_counter() - began) / calls


def _difference(policy: TrackingPolicy, exported: Exported, p: Array, observation: Array) -> float:
    """The largest difference of the controls along the plan for ``p`` (np,) at one ``observation`` (nx + nc,)."""
    plan, largest = policy.planner(p[None]), 0.0
    state = policy.follow(plan, policy.problem.start(p[None])[1])
    exported.follow(plan.flat()[0], p)
    for _ in range(state.states.shape[1] + 1):
        wanted, state = policy.act(observation[None], state, np.zeros(1, bool))
        difference = np.abs(exported.act(observation) - wanted[0]) / policy.problem.system.control.width
        largest = max(largest, float(difference.max()))
    return largest
