"""The chain of solvers of one nonlinear program: the part of the solver that runs in a child process.

The primary solver is fatrop (Vanroye et al., *FATROP: a fast constrained optimal control problem solver for robot
trajectory optimization and control*, IROS 2023), with compiled functions. It has no restoration phase: where its line
search gets stuck, usually with the duration at its lower bound, a second attempt continues from there with a longer
duration. *Measured* on 600 random pendulum instances, this recovers twice as many as IPOPT with its restoration, in a
tenth of the time.

The fallback is IPOPT (Wächter & Biegler, *On the implementation of an interior-point filter line-search algorithm for
large-scale nonlinear programming*, 2006). It solves what the primary solver breaks down on: an exception, a number that
is not finite, a hang or a crash (see :mod:`ocp_envs.solvers.guard`); and, if the caller asks for it, what the primary
solver did not converge on. Iteration limits decide how a solve ends, never time.

With the primary solver "riccati", the method of :mod:`ocp_envs.solvers.interior` comes before fatrop, which solves what
it does not, on the same conditions.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cached_property

from ocp_envs.solvers import cpu_limit
from ocp_envs.solvers.interior import InteriorPoint
from ocp_envs.solvers.nlp import Outcome, Result, SolverSettings, Task
from ocp_envs.solvers.plugins import Backend, Plugin, fallback_plugin, primary_plugin
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support.arrays import Array


class NlpSolver:
    """The solvers of the program ``transcription``, as ``settings`` say; not to be shared between threads."""

    def __init__(self, transcription: Transcription, settings: SolverSettings) -> None:
        self._transcription, self._settings = transcription, settings
        self._limited: dict[int, Plugin] = {}
        self._own: InteriorPoint | None = None
        if settings.primary == "riccati":
            self._own = InteriorPoint.of(transcription, settings)
        self._plugin = self._primary_plugin(settings.max_iterations)
        self.primary: Backend = self._own or self._plugin

    def _primary_plugin(self, iterations: int) -> Plugin:
        """The primary solver among CasADi's with a limit of ``iterations``."""
        plugin = "ipopt" if self._settings.primary == "ipopt" else "fatrop"
        return primary_plugin(self._transcription, plugin, self._settings, iterations)

    def _limited_to(self, iterations: int) -> Plugin:
        """The same with a limit of ``iterations``; kept, since setting it up takes longer than a solve."""
        if iterations not in self._limited:
            self._limited[iterations] = self._primary_plugin(iterations)
        return self._limited[iterations]

    @cached_property
    def fallback(self) -> Plugin:
        """The fallback solver; made when it is needed, for it rarely is."""
        return fallback_plugin(self._transcription, self._settings)

    def _primaries(self, task: Task) -> Iterator[Backend]:
        """The solvers of ``task`` before the fallback, in their order."""
        if self._own is not None:
            yield self._own
        yield self._plugin if task.iterations is None else self._limited_to(task.iterations)

    def _attempts(self, backend: Backend, task: Task, lower: Array, upper: Array) -> tuple[Outcome, int]:
        """Run ``backend`` on ``task`` with the bounds ``lower`` and ``upper`` of w, again where it is stuck."""
        outcome, iterations = backend.run(task, lower, upper)
        for again in backend.again if task.iterations is None else ():
            if outcome is not Outcome.STUCK:
                break
            start = task.guess if again.from_guess else backend.w
            guess = self._transcription.with_duration(start, again.duration, lower, upper)
            outcome, more = backend.run(task._replace(guess=guess), lower, upper)
            iterations += more
        return outcome, iterations

    def solve(self, task: Task, skip_primary: bool = False) -> Result:
        """Solve ``task`` with the primary solver, in several attempts, then where necessary with the others.

        With ``skip_primary`` the fallback is used at once.
        """
        began = time.perf_counter()
        bounds = self._transcription.bounds(task.target, task.parameter[self._transcription.nx :])
        retry = {Outcome.STUCK: task.retry_with_fallback, Outcome.BROKE_DOWN: task.rescue or skip_primary}
        backend, outcome, iterations, used = self.primary, Outcome.BROKE_DOWN, 0, 0
        for backend in () if skip_primary else self._primaries(task):
            outcome, more = self._attempts(backend, task, *bounds)
            iterations, used = iterations + more, used + 1
            if not retry.get(outcome, False):
                break
        if retry.get(outcome, False):
            cpu_limit.begin_fallback()
            if outcome is Outcome.STUCK:
                task = task._replace(guess=backend.w)
            backend, used = self.fallback, used + 2
            outcome, more = backend.run(task, *bounds)
            iterations += more
        return Result(
            status=backend.status(outcome),
            w=backend.w.copy(),
            cost=float(backend.cost[0]) * self._transcription.cost_scale,
            multipliers=self._transcription.clearance_multipliers(backend.lam_g),
            iterations=iterations,
            fallback=used > 1,
            seconds=time.perf_counter() - began,
        )
