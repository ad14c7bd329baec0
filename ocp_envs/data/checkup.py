"""A check of a declared problem by a few of its instances: what will go wrong later, said before it does.

What the declaration alone shows is refused when a problem is made. Whether initial states are feasible, the solver
succeeds, the Runge-Kutta steps are accurate, scales fit and optima keep clear of the bounds shows in solutions alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocp_envs.data.many import Optima, solve_many
from ocp_envs.feasibility import infeasible_rows
from ocp_envs.points import points_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.solvers.fidelity import fidelity
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.arrays import Array
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trial import Functions

#: Whether all is well, something deserves a look, or something is wrong.
Verdict = Literal["well", "look", "wrong"]
#: Instances of which only the initial condition is looked at.
_DRAWN = 200
#: How much of its scale a coordinate may move, at most and at least, without a remark.
_RANGE = (1e-3, 1e3)
#: How near a bound a state touches it, as a fraction of the box.
_TOUCH = 1e-4
#: What a derivative at the goal may be, in scales a second, where terminal regulation holds the goal.
_HELD = 1e-6
_MARKS = {"well": "ok   ", "look": "look ", "wrong": "WRONG"}


@checked
@dataclass(frozen=True)
class Finding:
    """What one check found of its ``subject``: a ``verdict``, "well", "look" or "wrong", and a sentence, ``text``."""

    subject: str
    verdict: Verdict
    text: str

    def __str__(self) -> str:
        return f"{_MARKS[self.verdict]} {self.subject}: {self.text}"


@checked
@dataclass(frozen=True, eq=False)
class Checkup:
    """What a check of ``problem`` found, ``findings``, and the instances that were solved for it, ``optima``."""

    problem: OptimalControlProblem
    findings: Sequence[Finding]
    optima: Optima

    def __repr__(self) -> str:
        return f"<Checkup of {self.problem.id!r}: {len(self.faults)} faults>"

    def __str__(self) -> str:
        return "\n".join([f"{self.problem.id}:", *map(str, self.findings)])

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The findings that deserve a look or are wrong."""
        return tuple(each for each in self.findings if each.verdict != "well")

    @property
    def well(self) -> bool:
        """Whether there are none."""
        return not self.faults


@checked
def check(problem: ProblemOrId, *, instances: int = 5, seed: int = 0) -> Checkup:
    """Try a problem on a few instances, and say what is well and what is not; ``print`` shows it.

    What is found is never an error. With a C compiler, the first call for a problem compiles its functions.

    Args:
        problem: the problem.
        instances: how many are solved, at most 1000.
        seed: of the instances.

    Raises:
        ValueError: a number out of its range.
    """
    problem = problem_of(problem)
    check_whole("instances", instances, 1, 1000)
    generators = [np.random.default_rng((seed, row)) for row in range(max(_DRAWN, instances))]
    p = problem.distribution.draw(problem, generators)
    feasible = np.setdiff1d(np.arange(len(p)), list(infeasible_rows(problem, p)))
    found = [*_functions(problem), *_goal(problem), *_initial_states(problem, p)]
    try:
        optima = solve_many(problem, p[feasible[:instances]], extrapolate=True)
        found += _solutions(optima)
    except (ValueError, RuntimeError) as error:  # of functions that the declaration does not try, such as families
        optima = Optima(problem, ())
        found.append(Finding("solver", "wrong", f"solving raises {type(error).__name__}: {error}"))
    for part in (_steps, _families, _bounds, _scales) if optima.solved.any() else ():
        found += part(optima)
    return Checkup(problem, tuple(found), optima)


def _functions(problem: OptimalControlProblem) -> Iterator[Finding]:
    """Values and derivatives of the functions at the goal, at initial states and in the box."""
    functions, sets = Functions.of(problem), points_of(problem)
    for where, (values, derivatives) in zip(sets, functions.evaluate(*sets)):
        broken = ~np.isfinite(values) | ~np.isfinite(derivatives).all(axis=2)
        for i in np.flatnonzero(broken.any(axis=0))[:1]:
            rows = np.flatnonzero(broken[:, i])
            text = f"{functions.names[i]} or its derivative is not finite at {len(rows)} of {len(values)} points "
            yield Finding("functions", "look", f"{text}{where.called}, such as {where.text(problem, int(rows[0]))}")
            return
    yield Finding("functions", "well", "values and derivatives are finite at the goal, initial states and in the box")


def _goal(problem: OptimalControlProblem) -> Iterator[Finding]:
    at_goal = points_of(problem)[0]
    rate, _ = problem.functions.rate()(at_goal.states, at_goal.controls, at_goal.contexts)
    largest = np.abs(rate / problem.system.state.scale).max(axis=0)
    worst = int(largest.argmax())
    name = problem.system.state.names[worst]
    if problem.hold == 0:
        yield Finding("goal", "well", "not held: success is evaluated at the plan's end (hold = 0)")
    elif largest[worst] <= _HELD:
        yield Finding("goal", "well", f"an equilibrium, held for {problem.hold:g} s after the plan")
    else:
        text = f"{name} drifts by {largest[worst]:.2g} of its scale a second where the goal is to be held; "
        yield Finding("goal", "look", f"{text}let the goal's control depend on the context, or set hold = 0")


def _initial_states(problem: OptimalControlProblem, p: Array) -> Iterator[Finding]:
    reasons = infeasible_rows(problem, p)
    if reasons:
        first = next(iter(reasons))
        text = f"{len(reasons)} of {len(p)} instances are infeasible before any solve, such as {p[first]}: "
        yield Finding("parameters", "look", text + reasons[first])
    else:
        yield Finding("parameters", "well", f"the ends of {len(p)} random instances violate no constraint")


def _solutions(optima: Optima) -> Iterator[Finding]:
    failed = [each for each in optima if each.status != Status.SOLVED]
    solved = len(optima) - len(failed)
    if not len(optima):
        yield Finding("solver", "wrong", "no instance is feasible; move the parameter box or the constraints")
    elif failed:
        verdict: Verdict = "look" if solved else "wrong"
        text = f"{solved} of {len(optima)} instances are solved; {failed[0].parameters} ends as "
        why = failed[0].failure
        cure = f"; try {why.advice[0]}" if why and why.advice else ""
        yield Finding("solver", verdict, f"{text}{failed[0].status.name}: {failed[0].reason}{cure}")
    else:
        yield Finding("solver", "well", f"all of {len(optima)} instances are solved")


def _steps(optima: Optima) -> Iterator[Finding]:
    solved = optima.samples()
    found = fidelity(optima.problem, solved.parameters, solved.trajectory)
    for fault in found.faults:
        yield Finding("between knots", "look", fault)
    if not found.faults:
        yield Finding("between knots", "well", found.text)


def _families(optima: Optima) -> Iterator[Finding]:
    names, costs = optima.problem.modes.names, optima.mode_costs[optima.solved].min(axis=0)
    never = [name for name, cost in zip(names, costs) if not np.isfinite(cost)]
    best = len(np.unique(optima.mode[optima.solved]))
    text = f"{best} of {len(names)} solution families hold an optimum of these instances"
    if never:
        text += f"; no trajectory was found of {never}: if there is none, leave them out"
    yield Finding("families", "well", text)


def _bounds(optima: Optima) -> Iterator[Finding]:
    """States that touch their bounds, where an environment ends an episode."""
    box, states = optima.problem.system.state, optima.samples().trajectory.states
    gap = np.minimum(states - box.lower, box.upper - states)[:, 1:] / (box.upper - box.lower)
    touching = np.asarray((gap < _TOUCH).any(axis=1))
    for i in np.flatnonzero(touching.any(axis=0)):
        text = f"{touching[:, i].sum()} of {len(states)} optima touch the bounds of {box.names[i]}, beyond which an "
        cure = "episode ends; give plans narrower bounds (planned=…) or the system wider ones"
        yield Finding("bounds", "look", text + cure)
    if not touching.any():
        yield Finding("bounds", "well", "the optima stay clear of the bounds of states")


def _scales(optima: Optima) -> Iterator[Finding]:
    """How far coordinates move, in their scales."""
    box, states = optima.problem.system.state, optima.samples().trajectory.states
    moved = states.max(axis=(0, 1)) - states.min(axis=(0, 1))
    ratio = moved / box.scale
    odd = (ratio > _RANGE[1]) | ((ratio < _RANGE[0]) & (moved > 0))
    for i in np.flatnonzero(odd):
        text = f"{box.names[i]} moves over {moved[i]:.2g}, {ratio[i]:.2g} times its scale {box.scale[i]:g}; "
        yield Finding("scales", "look", text + f"give it Coordinate(…, scale={moved[i] / 2:.1g})")
    if not odd.any():
        yield Finding("scales", "well", f"states move over {ratio.min():.2g} to {ratio.max():.2g} of their scales")
