"""The plant of an environment: control steps of its episodes with delay, disturbance and observation noise."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from typing import NoReturn

import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike

from ocp_envs.envs.interface import Interface
from ocp_envs.envs.options import EnvOptions
from ocp_envs.envs.specification import completed
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.batch import BatchFunction
from ocp_envs.support.clock import count_steps
from ocp_envs.support.doors import checked

#: Index of all rows: basic indexing is faster than that by an array of integers.
ALL = slice(None)
#: Standard normal numbers (len(rows), nx) for the rows given, each row's from a generator of its own.
Normal = Callable[[Ints], Array]


class Plant:
    """A number ``rows`` of episodes of an environment with ``options``, as batched arrays.

    Attributes:
        step: the arrays of a control step; its ``state`` is the present state of each episode.
        parameters: p of each episode, (rows, np).
    """

    def __init__(self, options: EnvOptions, rows: int) -> None:
        self.options = options
        self.rows = rows
        self.step = options.simulator.control_step(rows, options.disturbed)
        self.parameters = np.zeros((rows, len(options.problem.parameters)))
        # Where the duration is given, the goal counts from that time on.
        self.earliest = np.zeros(rows, dtype=np.int64)
        for column, name in enumerate(options.varied, start=len(options.problem.context)):
            self.step.context[:, column] = self._of_rows(name)
        # Of shape (1, nx): with a single row nothing has to be broadcast.
        box = options.problem.system.state
        self._lower, self._upper = box.lower[None], box.upper[None]
        self._disturbance = np.asarray(options.disturbance)[None]
        self._noise = np.asarray(options.observation_noise)[None]
        self._late = deque(np.zeros((rows, options.problem.system.nu)) for _ in range(options.delay))
        self._lock = threading.RLock()

    def _of_rows(self, name: str) -> Array:
        """The values of the constant ``name`` in each row, (rows,)."""
        values = self.options.varied[name]
        if values.shape != (self.rows,):
            raise ValueError(
                f"{self.options.problem.id}: constants[{name!r}] must be one number, or one for each of {self.rows} "
                f"environments, got the shape {values.shape}"
            )
        return values

    @property
    def context(self) -> Array:
        """The context of each episode, (rows, nc); what is written into it is that of the next control step."""
        return self.step.context[:, : len(self.options.problem.context)]

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_lock", "_clearances")}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._lock = threading.RLock()

    def _refuse(self) -> NoReturn:
        raise RuntimeError(
            f"{self.options.problem.id}: another thread is using this environment; give each thread one of its own"
        )

    @contextmanager
    def alone(self) -> Iterator[None]:
        """The context in which no other thread can begin or advance episodes."""
        if not self._lock.acquire(False):
            self._refuse()
        try:
            yield
        finally:
            self._lock.release()

    def begin(self, rows: Ints, parameters: Array) -> None:
        """Begin the episodes ``rows`` with the ``parameters`` p of each, (len(rows), np)."""
        with self.alone():
            self._begin(rows, parameters)

    def _begin(self, rows: Ints, parameters: Array) -> None:
        index = ALL if len(rows) == self.rows else rows
        self.step.state[index], self.context[index] = self.options.problem.start(parameters)
        self.parameters[index] = parameters
        problem, contexts = self.options.problem, self.context[index]
        if problem.horizon.fixed:
            self.earliest[index] = count_steps(problem.horizon.of(contexts)[:, 1], self.options.dt)
        for controls in self._late:
            controls[index] = problem.terminal.controls(contexts)

    def inside_goal(self, rows: Ints) -> Bools:
        """Whether the states of ``rows`` are in the goal ball as episodes begin, (len(rows),)."""
        problem = self.options.problem
        error = problem.goal_error(self.step.state[rows], self.context[rows])
        return np.asarray((error < problem.goal.radius) & (self.earliest[rows] == 0))

    def terminal_cost(self, rows: Bools) -> Array | float:
        """φ at the present states of the ``rows`` (rows,) whose episodes end, 0 in the others."""
        if not rows.any():
            return 0.0
        (cost,) = self.options.simulator.problem.functions.terminal_cost()(self.step.state, self.step.context)
        return np.where(rows, cost[:, 0], 0.0)

    def safe_controls(self) -> Array:
        """The control at the goal in the contexts of the episodes, (rows, nu)."""
        return self.options.problem.terminal.controls(self.context)

    def violation(self, rows: Ints) -> Array | None:
        """Violation of the path constraints in the states of ``rows``, (len(rows),); ``None`` without constraints."""
        if self._clearances is None:
            return np.zeros(len(rows)) if self.options.problem.constrained else None
        (clearances,) = self._clearances(self.step.state[rows], self.context[rows])
        return np.asarray(np.maximum(0.0, -clearances.min(axis=1)))

    @cached_property
    def _clearances(self) -> BatchFunction | None:
        problem = self.options.problem
        return problem.functions.clearances() if problem.n_clearances else None

    def advance(self, controls: Array, rows: Ints, normal: Normal) -> None:
        """Advance the episodes ``rows`` by one control step; the others keep their state. The results are in ``step``.

        ``controls`` are those of all episodes, (rows, nu); with a delay they act later.
        ``normal`` draws the disturbance.
        """
        if not self._lock.acquire(False):  # inline: a context takes as long as the arithmetic of a single episode
            self._refuse()
        try:
            step, options = self.step, self.options
            index = ALL if len(rows) == self.rows else rows
            if options.delay:
                # Rows that stand still need no exception: before such a row moves again, an episode begins in it.
                late = self._late.popleft()
                step.control[:] = late
                late[:] = controls
                self._late.append(late)
            else:
                step.control[:] = controls
            if options.disturbed:
                step.disturbance[index] = self._disturbance * normal(rows)
            step.evaluate()
            if len(rows) == self.rows:
                step.state[:] = step.following
            else:  # a mask takes a third of the time of a selection
                moving = np.zeros((self.rows, 1), dtype=np.bool_)
                moving[rows] = True
                np.copyto(step.state, step.following, where=moving)
        finally:
            self._lock.release()

    def measure(self, rows: Ints, normal: Normal) -> Array:
        """The states (len(rows), nx) of ``rows`` with noise from ``normal``, clipped to the operating box."""
        state = self.step.state if len(rows) == self.rows else self.step.state[rows]
        measured: Array = state + self._noise * normal(rows)
        np.maximum(measured, self._lower, out=measured)
        return np.minimum(measured, self._upper, out=measured)


class Episodes:
    """What an environment shows of its episodes: arrays of one episode, or of all in their first axis."""

    options: EnvOptions
    _plant: Plant
    _shown: int | slice = ALL
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification, with the control steps to the time limit as ``max_episode_steps``."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = completed(spec, self.options)

    def __repr__(self) -> str:
        options, count = self.options, "" if self._shown == 0 else f"num_envs={self._plant.rows}, "
        limit = f"time_limit={options.time_limit}"
        return f"{type(self).__name__}({options.problem.id!r}, {count}dt={options.dt}, {limit})"

    @property
    def problem(self) -> OptimalControlProblem:
        """The nominal problem; the plant differs from it if ``constants`` were given."""
        return self.options.problem

    @property
    def dt(self) -> float:
        """Length of a control step, s."""
        return self.options.dt

    def reserved(self) -> AbstractContextManager[None]:
        """The context in which only this thread can step and reset; another one gets a ``RuntimeError``."""
        return self._plant.alone()

    @property
    def interface(self) -> Interface:
        """What a policy must know of the environment."""
        return self.options.interface

    @property
    def state(self) -> Array:
        """The true state, (nx,) or (num_envs, nx)."""
        return np.array(self._plant.step.state[self._shown])

    @checked
    def push(self, change: ArrayLike) -> None:
        """Move the true state at once, between two control steps; at the bounds of the operating box it stops.

        Args:
            change: what is added to the state, (nx,) or (num_envs, nx), in the units of its coordinates.

        Raises:
            ValueError: another shape, or a number that is not finite.
        """
        state, box = self._plant.step.state, self.options.problem.system.state
        added = np.asarray(change, dtype=np.float64)
        if added.shape not in (state[self._shown].shape, state.shape[1:]) or not np.isfinite(added).all():
            raise ValueError(
                f"{self.options.problem.id}: change must be finite numbers for {', '.join(box.names)}, of the shape "
                f"{state[self._shown].shape}, got {change!r:.80}"
            )
        with self._plant.alone():
            state[self._shown] = np.clip(state[self._shown] + added, box.lower, box.upper)

    @property
    def context(self) -> Array:
        """The context, (nc,) or (num_envs, nc)."""
        return np.array(self._plant.context[self._shown])

    @property
    def parameters(self) -> Array:
        """p of the present episodes, (np,) or (num_envs, np)."""
        return np.array(self._plant.parameters[self._shown])
