"""Verified solutions per second of the solver of this package and of CasADi's ``Opti``, by kind of guess.

Kinds of guesses: straight lines (``line``), random ones (``cold``), the solution of the nearest of some solved
instances (``warm``), and a local linear fit through the nearest of them (``fit``), as in the generation of some
training sets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from moe_policy.reports.records import ABSENT, Absent, Record
from moe_policy.reports.tables import Column
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.warm_starts import local_fit
from ocp_envs.data.worker import start_from
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.sampling import sample
from ocp_envs.solvers.guesses import guesses, random_kind
from ocp_envs.solvers.nlp import Result, SolverSettings, Status, Task
from ocp_envs.solvers.solutions import Solutions, collect, make_tasks
from ocp_envs.solvers.transcription import transcribe
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.provenance import Provenance
from ocp_envs.trajectory import Trajectory

#: Stored solutions that a fit goes through, as many as in the generation of the quadcopters' sets.
FIT = 40
KINDS = ("line", "cold", "warm", "fit")
#: The solvers that ours is compared with.
OPTI = ("opti", "opti_expanded")
#: On a core of its own a solve that takes a second hangs.
ON_ONE_CORE = SolverSettings(hang_factor=25.0, hang_floor=1.0)
#: The same with the interior-point method in C.
RICCATI = replace(ON_ONE_CORE, primary="riccati")
#: (parameters, guesses, windings of the goal) → solutions.
Solve = Callable[[Array, Trajectory, Ints], Solutions]


@dataclass(frozen=True, kw_only=True)
class Rate(Record):
    """Rate of one solver with one kind of guess; medians and sum over the solves with a verified solution."""

    verified: int
    seconds: float
    verified_per_second: float
    iterations_median: float
    milliseconds_median: float
    statuses: dict[str, int]
    cost_sum: float


@dataclass(frozen=True, kw_only=True)
class Comparison(Record):
    """All solvers with one kind of guess; ratio: rate of ours / the larger rate of ``Opti``.

    ``riccati`` is ours with that method in C as primary solver, ``riccati_ratio`` its ratio.
    """

    ours: Rate
    opti: Rate
    opti_expanded: Rate
    ratio_to_the_better: float
    riccati: Rate | Absent = ABSENT
    riccati_ratio: float | Absent = ABSENT

    def text(self, kind: str) -> str:
        """Rates in a few lines."""
        lines = []
        for name in ("ours", "riccati", *OPTI):
            rate: Rate | Absent = getattr(self, name)
            if rate is not ABSENT:
                lines.append(
                    f"{kind:5s} {name:14s} {rate.verified:5d} verified, {rate.verified_per_second:8.1f} per second, "
                    f"{rate.iterations_median:.0f} iterations"
                )
        ratios = [f"{each:.1f}" for each in (self.ratio_to_the_better, self.riccati_ratio) if each is not ABSENT]
        return "\n".join([*lines, f"{kind:5s} ratio to the better Opti: {', '.join(ratios)}"])


@dataclass(frozen=True, kw_only=True)
class SolverSpeed(Record):
    """The solver of this package against ``Opti`` on one problem, by kind of guess.

    ``solves``: one for every winding of the goal of every instance; ``plain`` and ``plain_riccati``: the
    :func:`plain_ratio` of both of our solvers.
    """

    env_id: str
    seed: int
    parameters: int
    rounds: int
    solves: int
    tolerance: float
    stored: int
    start_seconds: float
    line: Comparison | Absent = ABSENT
    cold: Comparison | Absent = ABSENT
    warm: Comparison | Absent = ABSENT
    fit: Comparison | Absent = ABSENT
    plain: float | Absent = ABSENT
    plain_riccati: float | Absent = ABSENT
    provenance: Provenance


#: Names of the kinds of guesses.
_NAMES = {"line": "straight line", "cold": "random", "warm": "nearest solution", "fit": "fit through solutions"}
Line = tuple[str, Comparison]


def lines_of(record: SolverSpeed) -> list[Line]:
    """The comparisons of ``record``, each with the name of its guesses."""
    found = [(_NAMES[kind], getattr(record, kind)) for kind in KINDS]
    return [(name, each) for name, each in found if each is not ABSENT]


def _better(line: Line) -> Rate:
    return max(line[1].opti, line[1].opti_expanded, key=lambda rate: rate.verified_per_second)


def _riccati(line: Line) -> int | None:
    return None if line[1].riccati is ABSENT else line[1].riccati.verified


def _gain(line: Line) -> float | None:
    return None if line[1].riccati_ratio is ABSENT else line[1].riccati_ratio


SPEED_COLUMNS: tuple[Column[Line], ...] = (
    Column("guess", lambda line: line[0]),
    Column("verified: Opti", lambda line: _better(line).verified, "d"),
    Column("fatrop", lambda line: line[1].ours.verified, "d"),
    Column("riccati", _riccati, "d"),
    Column("verified per second: Opti", lambda line: _better(line).verified_per_second, ".0f"),
    Column("fatrop / Opti", lambda line: line[1].ratio_to_the_better, ".1f"),
    Column("riccati / Opti", _gain, ".1f"),
)


def draw(problem: OptimalControlProblem, size: int, seed: int) -> tuple[Array, Ints]:
    """Every winding of the goal of ``size`` random instances: parameters (B, np) and index of the winding (B,)."""
    count = len(problem.targets)
    return np.repeat(sample(problem, seed, size), count, axis=0), np.tile(np.arange(count), size)


def all_guesses(
    problem: OptimalControlProblem, solve: Solve, parameters: Array, stored: int, seed: int
) -> dict[str, Trajectory]:
    """A guess of every kind for ``parameters``, of `draw`; warm ones from ``stored`` instances, solved here."""
    windings = np.tile(np.arange(len(problem.targets)), len(parameters) // len(problem.targets))
    line = guesses(problem, parameters, windings, np.random.default_rng(seed + 3), "line")
    cold = guesses(problem, parameters, windings, np.random.default_rng(seed + 1), random_kind(problem))
    return {"line": line, "cold": cold, **_warm(problem, solve, parameters, stored, seed + 2)}


def _warm(
    problem: OptimalControlProblem, solve: Solve, parameters: Array, size: int, seed: int
) -> dict[str, Trajectory]:
    """The solution of the nearest of ``size`` solved instances, and a fit through several, for every winding."""
    count = len(problem.targets)
    stored, windings = draw(problem, size, seed)
    solutions = solve(stored, guesses(problem, stored, windings, np.random.default_rng(seed), "line"), windings)
    nearest, fitted = [], []
    for winding in range(count):
        usable = np.flatnonzero(solutions.solved & (windings == winding))
        known, wanted = Neighbours(problem.parameters, stored[usable]), parameters[winding::count]
        distance, around = known.nearest(wanted, FIT)
        z = solutions.trajectory[usable].flat().astype(np.float32)
        nearest.append(z[around[:, 0]])
        fitted.append(local_fit(known.offsets(wanted, around), distance, z[around]))
    order = np.argsort(np.tile(np.arange(len(parameters) // count), count), kind="stable")
    return {
        kind: start_from(problem, parameters, np.concatenate(parts)[order])
        for kind, parts in (("warm", nearest), ("fit", fitted))
    }


def measure(solve: Solve, parameters: Array, guess: Trajectory, windings: Ints) -> Rate:
    """Rate of one solver in one round, after a few solves that warm it up."""
    few = slice(0, 3)
    solve(parameters[few], guess[few], windings[few])
    began = time.perf_counter()
    solutions = solve(parameters, guess, windings)
    seconds = time.perf_counter() - began
    solved = solutions.solved
    return Rate(
        verified=int(solved.sum()),
        seconds=seconds,
        verified_per_second=float(solved.sum() / seconds),
        iterations_median=float(np.median(solutions.iterations[solved])),
        milliseconds_median=float(1e3 * np.median(solutions.seconds[solved])),
        statuses={status.name: int((solutions.status == status).sum()) for status in Status},
        cost_sum=float(solutions.cost[solved].sum()),
    )


def compare(
    solvers: Mapping[str, Solve], rounds: int, parameters: Array, guess: Trajectory, windings: Ints
) -> Comparison:
    """The fastest of several ``rounds`` of "ours", "riccati" and `OPTI`.

    They take turns, so that other load affects all.
    """
    tried = [{name: measure(s, parameters, guess, windings) for name, s in solvers.items()} for _ in range(rounds)]
    rates = {name: min((row[name] for row in tried), key=lambda rate: rate.seconds) for name in solvers}
    best = max(rates[name].verified_per_second for name in OPTI)
    ratio, riccati = (rates[name].verified_per_second / best for name in ("ours", "riccati"))
    return Comparison(**rates, ratio_to_the_better=ratio, riccati_ratio=riccati)


def plain_ratio(compared: Mapping[str, Comparison], solver: str = "ours") -> float | Absent:
    """Highest rate of ``solver``, "ours" or "riccati", to the highest of ``Opti`` without a warm start.

    Absent if one of them was not measured in ``compared``.
    """
    plain = [getattr(compared[kind], name) for kind in ("line", "cold") if kind in compared for name in OPTI]
    rates = [rate for one in compared.values() if (rate := getattr(one, solver)) is not ABSENT]
    if not plain or not rates:
        return ABSENT
    return max(rate.verified_per_second for rate in rates) / max(rate.verified_per_second for rate in plain)


class PlainOpti:
    """IPOPT on the nonlinear program of this package, its functions as they are or expanded to scalar expressions."""

    def __init__(self, problem: OptimalControlProblem, tolerance: float, expand: bool) -> None:
        self.problem, self.program = problem, transcribe(problem)
        lower, upper = (b for b in self.program.bounds(0, problem.context.centre))
        opti = ca.Opti()
        self.w, self.p = opti.variable(len(lower)), opti.parameter(self.program.nlp.numel_in("p"))
        self.lower, self.upper = opti.parameter(len(lower)), opti.parameter(len(upper))
        cost, g = self.program.nlp(self.w, self.p)
        low, high = self.program.constraint_bounds
        opti.minimize(cost)
        opti.subject_to(opti.bounded(self.lower, self.w, self.upper))
        equal = np.flatnonzero(low == high).tolist()
        opti.subject_to(g[equal] == 0)
        if len(equal) < len(low):
            opti.subject_to(g[np.flatnonzero(low != high).tolist()] >= 0)
        opti.solver("ipopt", {"print_time": False, "expand": expand}, {"print_level": 0, "sb": "yes", "tol": tolerance})
        self.opti = opti

    def solve(self, parameters: Array, guess: Trajectory, windings: Ints) -> Solutions:
        """Solve ``parameters`` (B, np) as the solver of this package does, the independent check included."""
        tasks = make_tasks(self.problem, self.program, parameters, guess, windings)
        return collect(self.problem, self.program, parameters, [self._one(task) for task in tasks])

    def _one(self, task: Task) -> Result:
        began, opti = time.perf_counter(), self.opti
        lower, upper = self.program.bounds(task.target, task.parameter[self.program.nx :])
        opti.set_value(self.p, task.parameter)
        opti.set_value(self.lower, lower)
        opti.set_value(self.upper, upper)
        opti.set_initial(self.w, task.guess)
        try:
            opti.solve()
            status = Status.SOLVED
        except RuntimeError:
            status = Status.NOT_CONVERGED
        w, cost = np.array(opti.debug.value(self.w)), float(opti.debug.value(opti.f))
        iterations = int(opti.stats()["iter_count"])
        unused = np.zeros(self.program.rows.clearances.shape)
        return Result(status, w, cost, unused, iterations, False, time.perf_counter() - began)
