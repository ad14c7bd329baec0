"""Many episodes of a problem as one batched Gymnasium environment, in one process and without a loop over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ocp_envs.envs.actions import controls_of, nan_rows
from ocp_envs.envs.generators import Generators
from ocp_envs.envs.options import RENDER_MODES, EnvOptions, refuse_unknown
from ocp_envs.envs.outcome import Info, Outcome
from ocp_envs.envs.pictures import Pictures
from ocp_envs.envs.plant import ALL, Episodes, Plant
from ocp_envs.envs.resets import MASK, NAMES, due_rows, given_parameters
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.batch import MOST_ROWS
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    modes = [each.value for each in AutoresetMode]
    if not isinstance(mode, AutoresetMode) and mode not in modes:
        raise ValueError(f"autoreset_mode: expected one of {modes}, got {mode!r}")
    return AutoresetMode(mode)


class VectorEnv(Episodes, gym.vector.VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """``num_envs`` episodes of :class:`~ocp_envs.envs.env.Env` as batched arrays.

    Spaces, reward, initial states and ends of episodes are those of :class:`~ocp_envs.envs.env.Env`. ``info`` follows
    Gymnasium's vector convention: arrays of length ``num_envs`` and a mask ``_key`` of the rows that have the key.
    ``options["parameters"]`` is (np,) for all rows or (num_envs, np); ``options["reset_mask"]``, (num_envs,) bool,
    selects the rows that are reset. A row whose action is NaN is under the control that holds the goal for this control
    step, and ``info["invalid_action"]`` marks it; the other rows go on.

    Args:
        problem: the problem or its name; given by ``gym.make_vec``.
        num_envs: number of episodes.
        autoreset_mode: what follows the end of an episode. ``NEXT_STEP``: the next step resets it, ignoring its
            action, with reward 0. ``SAME_STEP``: it is reset at once; ``info`` has ``final_obs`` and ``final_info``.
            ``DISABLED``: the row stands still, with reward 0 and its end still flagged, until it is reset.
        dt, terminate_at_goal, time_limit, max_episode_steps, constants: as in
            :class:`~ocp_envs.envs.env.Env`; so are the errors.
        disturbance, observation_noise, delay, render_mode: as in :class:`~ocp_envs.envs.env.Env`; so are the errors.
    """

    metadata: ClassVar[Info] = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # type: ignore[misc]

    @checked
    def __init__(
        self,
        problem: ProblemOrId,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
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
        refuse_unknown(VectorEnv, unknown)
        problem = problem_of(problem)
        check_whole("num_envs", num_envs, 1, MOST_ROWS)
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
        self.num_envs = num_envs
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**options.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.render_mode = options.render_mode
        self.single_observation_space = options.observation_space
        self.single_action_space = options.action_space
        self.observation_space = batch_space(options.observation_space, num_envs)
        self.action_space = batch_space(options.action_space, num_envs)
        self._plant = Plant(options, num_envs)
        self._generators = Generators(num_envs, self.problem.system.nx)
        self._observed = np.zeros((num_envs, *options.observation_space.shape), dtype=np.float32)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._terminated = np.zeros(num_envs, dtype=np.bool_)
        self._truncated = np.zeros(num_envs, dtype=np.bool_)
        self._all = np.arange(num_envs)
        self._begun = False
        self._outcome = Outcome.none(num_envs, len(problem.parameters), problem.constrained)
        self._running_cost = self._outcome.cost
        self._given = np.zeros((num_envs, problem.system.nu))
        self._pictures = Pictures(self._plant)

    @property
    def costs(self) -> Array:
        """Costs of the last control step without a terminal cost, which no wrapper changes, (num_envs,)."""
        return self._running_cost.copy()

    @property
    def left_box(self) -> Bools:
        """Which episodes left the operating box in the last control step, (num_envs,)."""
        return self._outcome.left_box.copy()

    @property
    def controls(self) -> Array:
        """Actions that the last control step was given, before they are clipped and delayed, (num_envs, nu)."""
        return self._given.copy()

    @property
    def steps(self) -> Ints:
        """Control steps since each episode began, (num_envs,)."""
        return self._steps.copy()

    @checked
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Info | None = None
    ) -> tuple[NDArray[np.float32], Info]:
        """Begin episodes and return the observations and ``info``.

        Args:
            seed: an integer s seeds row i with s + i; a sequence gives each row its own.
            options: ``parameters``, ``extrapolate`` and ``reset_mask``; see the class.

        Raises:
            ResetNeeded: a first reset with a ``reset_mask`` that leaves rows out.
            ValueError: an unknown option, or parameters of another shape, not finite, or outside the box without
                ``extrapolate``.
        """
        options = options or {}
        p = given_parameters(self.problem, options, self.num_envs, (*NAMES, MASK))
        rows = due_rows(self.problem, options, self.num_envs)
        if not self._begun and len(rows) < self.num_envs:
            raise ResetNeeded("the first reset must begin all rows; call reset() without a reset_mask")
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
        self._generators.seed(seed, rows)
        begun = np.zeros(self.num_envs, dtype=np.bool_)
        begun[rows] = True
        none = Outcome.none(self.num_envs, len(self.problem.parameters), self.problem.constrained)
        info = none.replaced(begun, self._begin(rows, None if p is None else p[rows])).info(begun)
        self._begun = True
        self._pictures.update()
        return self._observed.copy(), info

    def _begin(self, rows: Ints, parameters: Array | None = None) -> Outcome:
        """Begin episodes in ``rows`` with ``parameters`` (len(rows), np), drawn if not given; their ``info``."""
        if parameters is None:
            parameters = self.options.draw_parameters([self._generators[row] for row in rows])
        self._plant.begin(rows, parameters)
        self._observed[rows, self.problem.system.nx :] = self._plant.context[rows]
        self._steps[rows] = 0
        self._terminated[rows] = False
        self._truncated[rows] = False
        self._pictures.begin(rows)
        self._observe(rows)
        reached, violation = self._plant.inside_goal(rows), self._plant.violation(rows)
        none = np.zeros(len(rows), dtype=np.bool_)
        return Outcome(self._plant.parameters[rows], reached, np.zeros(len(rows)), none, violation, none)

    def _observe(self, rows: Ints) -> None:
        """Observe the states of ``rows``."""
        nx = self.problem.system.nx
        if self.options.noisy:
            index = ALL if len(rows) == self.num_envs else rows
            self._observed[index, :nx] = self._plant.measure(rows, self._generators.normal)
        elif 2 * len(rows) < self.num_envs:
            self._observed[rows, :nx] = self._plant.step.state[rows]
        else:  # all rows take less time than a selection; those that stand still are observed as before
            self._observed[:, :nx] = self._plant.step.state

    def step(self, actions: ArrayLike) -> tuple[NDArray[np.float32], Array, Bools, Bools, Info]:
        """Advance the episodes by one control step; rows whose episode is over stand still.

        ``actions`` are the controls, (num_envs, nu), clipped to their bounds; for NaN see the class. Returned are
        observations, rewards, terminated, truncated, each of ``num_envs`` rows, and ``info``.

        Raises:
            ResetNeeded: before the first :meth:`reset`.
            ValueError: actions of another shape, or that are no numbers.
        """
        if not self._begun:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        self._given = controls_of(self.problem, actions, self._plant.step.control.shape)
        invalid = nan_rows(self._given)
        controls = (
            np.where(invalid[:, None], self._plant.safe_controls(), self._given) if invalid.any() else self._given
        )
        over = self._terminated | self._truncated
        moving = ~over
        rows = np.flatnonzero(moving) if over.any() else self._all
        self._plant.advance(controls, rows, self._generators.normal)
        outcome = self._outcome = self._conclude(moving, invalid)
        self._observe(rows)
        self._pictures.record(rows, outcome.cost)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and over.any():
            info = outcome.replaced(over, self._begin(np.flatnonzero(over))).info(moving | over)
            terminated[over] = truncated[over] = False
        elif self.autoreset_mode is AutoresetMode.SAME_STEP and (ended := moving & (terminated | truncated)).any():
            final = outcome.final_info(ended, self._observed)
            info = outcome.replaced(ended, self._begin(np.flatnonzero(ended))).info(moving) | final
        else:
            info = outcome.info(moving)
        self._pictures.update()
        return self._observed.copy(), -outcome.cost, terminated, truncated, info

    def _conclude(self, moving: Bools, invalid: Bools) -> Outcome:
        """Charge the ``moving`` rows that left the box, and note which episodes ended; ``invalid`` actions are NaN."""
        step, options = self._plant.step, self.options
        self._steps += moving
        reached = (step.reached > 0) & moving
        if self.problem.horizon.fixed:
            reached &= self._steps >= self._plant.earliest
        left_box = (step.left_box > 0) & moving
        cost = np.where(moving, step.cost, 0.0)
        if left_box.any():
            cost[left_box] = options.charge(self._steps[left_box] - 1)
        self._running_cost = cost
        terminated = left_box | reached if options.terminate_at_goal else left_box
        self._terminated |= terminated
        truncated = moving & ~terminated & (self._steps >= options.max_steps)
        self._truncated |= truncated
        if self.problem.terminal_cost is not None:
            cost = cost + self._plant.terminal_cost((terminated & ~left_box) | truncated)
        violation = step.violation.copy() if self.problem.constrained else None
        return Outcome(self.parameters, reached, cost, left_box, violation, invalid & moving)

    def show_plan(self, plans: Trajectory) -> None:
        """Show ``plans``, one a row (else a ``ValueError``), in the pictures of the episodes; follows a reset."""
        self._pictures.announce(plans)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame (height, width, 3) per row in mode ``"rgb_array"``; a window with row 0 in mode ``"human"``."""
        return self._pictures.frames()

    def close_extras(self, **kwargs: object) -> None:
        """Close the window, if there is one; ``kwargs`` are not used."""
        self._pictures.close()
