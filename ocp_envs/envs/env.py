"""A problem as a Gymnasium environment: a thin shell on :meth:`ocp_envs.envs.simulation.Simulator.advance`.

:class:`Env` runs one episode, :class:`~ocp_envs.envs.vector_env.VectorEnv` any number of them as batched arrays; row i
of a
vector environment that was reset with ``seed=s`` is the single environment reset with ``seed=s + i``, draw by draw.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from ocp_envs.envs.options import RENDER_MODES, Settings
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.render.film import Film
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

__all__ = ["Env", "VectorEnv"]


class Env(gym.Env[NDArray[Any], NDArray[Any]]):
    """An optimal control problem as a Gymnasium environment.

    ## Description

    The system of an :class:`~ocp_envs.problem.OptimalControlProblem` is driven from the start state of a parameter p
    to a goal ball at the lowest cost ∫L dt. Time passes in ticks of ``dt`` seconds, the control is held within a tick.
    ``ocp_envs.describe(problem)`` writes the tables of one problem.

    ## Action Space

    ``Box(nu,)`` float32: the control in its physical units, clipped to its bounds.

    ## Observation Space

    ``Box(nx + nc,)`` float32: the state and the context (the part of p that is not a start state) within their
    operating boxes. Angles are unwrapped. The attributes ``state``, ``context``, ``parameters`` are exact, in float64.

    ## Reward

    Minus the cost of the tick, ∫L dt. Leaving the operating box is charged the largest cost rate over the boxes times
    the time that was left, so that failing early never pays.

    ## Starting State

    The start state of ``options["parameters"]``, (np,), if given to :meth:`reset`, else of a p uniform in the parameter
    box, or for a problem with a ``free`` one, of a p from its shipped table. ``options["extrapolate"] = True`` accepts
    a p outside the box.

    ## Episode End

    Terminated: the state is in the goal ball at the end of a tick (unless ``terminate_at_goal=False``), or it left the
    operating box (``info["failure"] == "left_box"``). Truncated: ``time_limit`` seconds have passed.

    ``info`` of a step: ``is_success`` (in the goal ball), ``cost`` (of the tick) and, where there is a path constraint,
    ``violation`` (how far it is violated at the end of the tick). ``info`` of a reset: ``parameters``.

    ## Arguments

    Args:
        problem: the problem or its name; given by ``gym.make``.
        dt: length of a tick in seconds.
        terminate_at_goal: whether the episode ends in the goal ball.
        time_limit: seconds until truncation; the problem's own by default.
        constants: other values of physical constants, for a plant that differs from the model.
        disturbance: standard deviation of a normal term added to ẋ, drawn for each tick; a number or (nx,).
        observation_noise: standard deviation of the normal noise on the observed state; a number or (nx,).
        delay: ticks by which the control acts late; until then the control that holds the goal acts.
        render_mode: ``None``, ``"rgb_array"`` or ``"human"``.

    ## Version History

    * v0: initial version.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # noqa: RUF012 (Gymnasium's type)

    def __init__(self, problem: OptimalControlProblem | str, **arguments: Any) -> None:
        self.settings = settings = Settings(problem, **arguments)  # type: ignore[arg-type]
        self.metadata = settings.metadata
        self.render_mode = settings.render_mode
        self.observation_space = settings.observation_space
        self.action_space = settings.action_space
        self._run = settings.simulator.bind(1, settings.disturbed)
        self._observed = np.zeros(settings.observation_space.shape, dtype=np.float32)
        self._tick = settings.ticks
        self._over = True
        self._queue: list[Array] = []
        self._parameters = np.zeros(len(self.problem.parameters))
        self._film = Film(settings.dt, 1)

    @property
    def problem(self) -> OptimalControlProblem:
        """The nominal problem; the plant differs from it if ``constants`` were given."""
        return self.settings.problem

    @property
    def dt(self) -> float:
        """Length of a tick in seconds."""
        return self.settings.dt

    @property
    def state(self) -> Array:
        """The true state, (nx,)."""
        return self._run.inputs[0][0].copy()

    @property
    def context(self) -> Array:
        """The context of the episode, (nc,)."""
        return self._run.inputs[2][0].copy()

    @property
    def parameters(self) -> Array:
        """p of the episode, (np,)."""
        return self._parameters.copy()

    def _observation(self) -> NDArray[np.float32]:
        nx = self._run.inputs[0].shape[1]
        state = self._run.inputs[0][0]
        if self.settings.noisy:
            noise = self.settings.observation_noise * self.np_random.standard_normal(nx)
            box = self.problem.system.state
            state = np.clip(state + noise, box.lower, box.upper)
        self._observed[:nx] = state
        return self._observed.copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see the class for ``options``.

        Raises:
            ValueError: an unknown option, or parameters of another shape, not finite, or outside the box without
                ``extrapolate``.
        """
        super().reset(seed=seed)
        known = self.settings.check_options(options)
        given = known.get("parameters")
        if given is None:
            p = self.settings.draw_parameters(self.np_random)[None]
        else:
            p = self.settings.check_start(given, known)
        if len(p) != 1:
            raise ValueError(f"{self.problem.id}: expected the parameters of one episode, got {len(p)} rows")
        states, contexts = self.problem.start(p)
        self._run.inputs[0][:] = states
        self._run.inputs[2][:] = contexts
        self._observed[states.shape[1] :] = contexts[0]
        self._parameters = p[0]
        self._queue = [self.problem.goal.control] * self.settings.delay
        self._tick = 0
        self._over = False
        if self.render_mode is not None:
            self._film.begin(np.array([0]), states)
            if self.render_mode == "human":
                self.render()
        return self._observation(), {"parameters": self.parameters}

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One tick of ``dt`` seconds under ``action``, (nu,).

        Raises:
            ResetNeeded: the episode is over or has not begun.
            ValueError: an action of another shape.
        """
        if self._over:
            raise ResetNeeded(
                "the episode is over or has not begun: call reset(); to go on beyond the goal, make the environment "
                "with terminate_at_goal=False"
            )
        settings, run = self.settings, self._run
        control = np.asarray(action, dtype=np.float64)
        if control.shape != run.inputs[1].shape[1:]:
            raise ValueError(f"{self.problem.id}: expected an action {run.inputs[1].shape[1:]}, got {control.shape}")
        if settings.delay:
            self._queue.append(control.copy())
            control = self._queue.pop(0)
        run.inputs[1][0] = control
        if settings.disturbed:
            run.inputs[3][0] = settings.disturbance * self.np_random.standard_normal(len(settings.disturbance))
        run()
        run.inputs[0][:] = run.outputs[0]
        cost, violation, reached, left_box = run.outputs[1][0].tolist()
        info: dict[str, Any] = {"is_success": reached > 0}
        if left_box:
            cost = settings.charge(settings.ticks - self._tick)
            info["failure"] = "left_box"
        info["cost"] = cost
        if self.problem.n_clearances:
            info["violation"] = violation
        self._tick += 1
        terminated = left_box > 0 or (reached > 0 and settings.terminate_at_goal)
        truncated = not terminated and self._tick >= settings.ticks
        self._over = terminated or truncated
        if self.render_mode is not None:
            self._film.record(np.array([0]), run.inputs[0], np.array([cost]))
            if self.render_mode == "human":
                self.render()
        return self._observation(), -cost, terminated, truncated, info

    def show_plan(self, plan: Trajectory) -> None:
        """Show ``plan``, a batch of one, in the pictures of this episode; call it after :meth:`reset`.

        Raises:
            ValueError: another number of plans.
        """
        self._film.announce(np.array([0]), plan)

    def render(self) -> NDArray[np.uint8] | None:
        """The frame (height, width, 3) in mode ``"rgb_array"``; a window in mode ``"human"``."""
        if self.render_mode is None:
            gym.logger.warn('render() needs render_mode="rgb_array" or "human" when the environment is made')
            return None
        context = self._run.inputs[2][0]
        if self.render_mode == "human":
            self._film.show(self.problem, 0, context)
            return None
        return self._film.frame(self.problem, 0, context)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._film.close()
