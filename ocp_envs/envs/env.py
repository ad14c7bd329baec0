"""A problem as a Gymnasium environment.

:class:`Env` runs one episode, :class:`~ocp_envs.envs.vector_env.VectorEnv` any number of them as batched arrays. Row i
of a vector environment that was reset with ``seed=s`` equals the single environment that was reset with
``seed=s + i``, random number by random number. Both read the actions, observe and decide when an episode ends; the
:class:`~ocp_envs.envs.plant.Plant` below them advances the state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from ocp_envs.envs.actions import controls_of
from ocp_envs.envs.options import RENDER_MODES, EnvOptions, refuse_unknown
from ocp_envs.envs.outcome import LEFT_BOX, Info
from ocp_envs.envs.pictures import Pictures
from ocp_envs.envs.plant import Episodes, Plant
from ocp_envs.envs.resets import given_parameters
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

_ROW = np.array([0])


class Env(Episodes, gym.Env[NDArray[Any], NDArray[Any]]):
    """An optimal control problem as a Gymnasium environment.

    ## Description

    The system of an :class:`~ocp_envs.problem.OptimalControlProblem` is to be driven from the initial state of a
    parameter p to a goal ball at minimum cost ∫L dt. The control is constant during a control step of ``dt`` seconds.
    ``ocp_envs.describe(problem)`` lists the coordinates, bounds and constants of a problem.

    ## Action Space

    ``Box(nu,)`` float32: the control in its physical units, clipped to its bounds. An action with a NaN is an error.

    ## Observation Space

    ``Box(nx + nc,)`` float32: the state and the context (the part of p that is not an initial state) within their
    operating boxes. Angles are unwrapped. The attributes ``state``, ``context`` and ``parameters`` are exact, in
    float64.

    ## Rewards

    Minus the cost ∫L dt of the control step. A step that leaves the operating box is charged the largest cost rate
    over the boxes times the time that was left, so that failing early never pays.

    ## Starting State

    The initial state of ``options["parameters"]``, (np,), if given to :meth:`reset`. Otherwise p is drawn: uniformly in
    the parameter box or, where a condition on the optimum restricts it, from the table shipped for the problem.
    ``options["extrapolate"] = True`` accepts a p outside the box.

    ## Episode End

    Terminated: the state is in the goal ball at the end of a control step (unless ``terminate_at_goal=False``), or it
    left the operating box (``info["failure"] == "left_box"``). Truncated: ``time_limit`` seconds have passed, or
    ``max_episode_steps`` control steps.

    ``info`` of a reset and of every step: ``parameters`` (np,), ``is_success`` (in the goal ball), ``cost`` (of the
    control step), ``failure`` (``"left_box"`` or ``""``) and, where there is a path constraint, ``violation``
    (how far it is violated at the end of the step).

    ## Arguments

    Args:
        problem: the problem or its name; given by ``gym.make``.
        dt: length of a control step, s.
        terminate_at_goal: whether the episode ends in the goal ball.
        time_limit: seconds until truncation; the problem's own by default.
        max_episode_steps: control steps until truncation, where ``time_limit`` does not truncate earlier.
        constants: other values of physical constants by name, for a plant that differs from the model; in a vector
            environment one number, or one for each environment, (num_envs,).
        disturbance: standard deviation of a normal term added to ẋ, drawn for each control step; a number or (nx,).
        observation_noise: standard deviation of the normal noise on the observed state; a number or (nx,).
        delay: control steps by which the control acts late; until then the control that holds the goal acts.
        render_mode: ``None``, ``"rgb_array"`` or ``"human"``.

    Raises:
        TypeError: an argument that is not in this list.
        ValueError: an argument out of its range.
        UnknownProblemError: no problem of that name.
    """

    _shown = 0
    metadata: Info = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # noqa: RUF012 (Gymnasium's type)

    @checked
    def __init__(
        self,
        problem: ProblemOrId,
        *,
        dt: float = 0.02,
        terminate_at_goal: bool = True,
        time_limit: float | None = None,
        max_episode_steps: int | None = None,
        constants: Mapping[str, ArrayLike] | None = None,
        disturbance: ArrayLike = 0.0,
        observation_noise: ArrayLike = 0.0,
        delay: int = 0,
        render_mode: str | None = None,
        **unknown: object,
    ) -> None:
        refuse_unknown(Env, unknown)
        problem = problem_of(problem)
        self.options = options = EnvOptions(
            problem,
            dt,
            terminate_at_goal,
            time_limit,
            max_episode_steps,
            constants,
            disturbance,
            observation_noise,
            delay,
            render_mode,
        )
        self.metadata = options.metadata
        self.render_mode = options.render_mode
        self.observation_space = options.observation_space
        self.action_space = options.action_space
        self._plant = Plant(options, 1)
        self._observed = np.zeros(options.observation_space.shape, dtype=np.float32)
        self._steps = options.max_steps
        self._over = True
        self._pictures = Pictures(self._plant)

    def _normal(self, rows: Ints) -> Array:
        """Standard normal numbers, (1, nx)."""
        return self.np_random.standard_normal((1, self._plant.step.state.shape[1]))

    def _observation(self) -> NDArray[np.float32]:
        state = self._plant.step.state
        measured = self._plant.measure(_ROW, self._normal) if self.options.noisy else state
        self._observed[: state.shape[1]] = measured
        return self._observed.copy()

    @checked
    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[NDArray[np.float32], Info]:
        """Begin an episode and return the observation and ``info``.

        Args:
            seed: restarts the environment's random generator.
            options: ``parameters`` (np,) and ``extrapolate``; see the class.

        Raises:
            ValueError: an unknown option, or parameters of another shape, not finite, or outside the box without
                ``extrapolate``.
        """
        super().reset(seed=seed)
        p = given_parameters(self.problem, options or {}, 1)
        self._plant.begin(_ROW, self.options.draw_parameters([self.np_random]) if p is None else p)
        self._observed[self.problem.system.nx :] = self._plant.context
        self._steps = 0
        self._over = False
        self._pictures.begin(_ROW)
        self._pictures.update()
        info: Info = {"parameters": self.parameters, "is_success": bool(self._plant.inside_goal(_ROW)[0]), "cost": 0.0}
        info["failure"] = ""
        violation = self._plant.violation(_ROW)
        if violation is not None:
            info["violation"] = float(violation[0])
        return self._observation(), info

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, Info]:
        """Advance the episode by one control step under ``action``, the control (nu,), clipped to its bounds.

        Returned are observation, reward, terminated, truncated and ``info``.

        Raises:
            ResetNeeded: the episode is over or has not begun.
            ValueError: an action of another shape, one that is no number, or NaN.
        """
        if self._over:
            raise ResetNeeded(
                "the episode is over or has not begun: call reset(); to go on beyond the goal, make the environment "
                "with terminate_at_goal=False"
            )
        options, step = self.options, self._plant.step
        control = controls_of(self.problem, action, step.control.shape[1:])[None]
        if math.isnan(control.min()):
            raise ValueError(
                f"{self.problem.id}: expected a finite action, got {control[0]}; look for a NaN in what computed it"
            )
        self._plant.advance(control, _ROW, self._normal)
        self._steps += 1
        cost, left_box = step.cost.item(), step.left_box.item() > 0
        reached = step.reached.item() > 0 and self._steps >= self._plant.earliest.item()
        terminated = left_box or (reached and options.terminate_at_goal)
        truncated = not terminated and self._steps >= options.max_steps
        if left_box:
            cost = float(options.charge(self._steps - 1))
        elif (terminated or truncated) and options.problem.terminal_cost is not None:
            cost += float(np.sum(self._plant.terminal_cost(np.ones(1, dtype=np.bool_))))
        info: Info = {"parameters": self.parameters, "is_success": reached, "cost": cost}
        info["failure"] = LEFT_BOX if left_box else ""
        if options.problem.constrained:
            info["violation"] = step.violation.item()
        self._over = terminated or truncated
        if self.render_mode is not None:
            self._pictures.record(_ROW, np.array([cost]))
            self._pictures.update()
        return self._observation(), -cost, terminated, truncated, info

    def show_plan(self, plan: Trajectory) -> None:
        """Show ``plan``, a batch of one (else a ``ValueError``), in the pictures of this episode; follows a reset."""
        self._pictures.announce(plan)

    def render(self) -> NDArray[np.uint8] | None:
        """The frame (height, width, 3) in mode ``"rgb_array"``; a window in mode ``"human"``."""
        frames = self._pictures.frames()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window, if there is one."""
        self._pictures.close()
