"""What the observations after the beginning of an episode tell about the environment.

Three things that a policy is not told can be seen in the first control steps:

- *Another episode.* No control moves the state in one control step as far as to the next observation, or the context
  has changed: a new episode has begun. A false alarm costs a second plan, from where the state is.
- *Another control period.* Of a coordinate whose rate g(x) depends on neither control nor constants, the movement is
  Δx = ∫ g dt' ≈ g̅ dt', whatever the plant. The regressions of Δx on g̅ and of g̅ on Δx bound dt' from both sides where
  both carry noise (Frisch, *Statistical confluence analysis*, 1934). A block of control steps contradicts dt if the
  bounds agree within half a per cent, over three steps or more in effect, and dt is outside them by a third.
- *Other actions.* The state moves as under the action rescaled from [-1, 1], a hundred times more exactly than under
  the action itself.

Delays and other constants contradict nothing; noise and disturbances contradict one block in hundreds. An error needs
two blocks, and half of all blocks so far. Control steps that are too long for the trapezoidal mean g̅, five times those
of the policy, need not be noticed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from moe_policy.control.observations import split
from moe_policy.protocols import State
from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.batch import BatchFunction, dense_function

#: Control steps of a block, and the blocks of an episode that are watched.
BLOCK, _BLOCKS = 6, 4
#: The last control step that is watched.
LAST = BLOCK * _BLOCKS
#: Contradictions, and the fraction of blocks with one, that are an error.
_ALARMS, _FRACTION = 2, 0.5
#: Deviation of the control period that contradicts it, the agreement of its bounds that it takes, and how many steps.
_DEVIATION, _AGREEMENT, _EFFECTIVE = 4 / 3, 0.995, 3.0
#: A movement within this multiple of the largest that a control can cause, plus this fraction of the box, is one.
_MARGIN, _SLACK = 3.0, 1e-3
#: Ratio of the squared residuals under rescaled and given actions that contradicts; the smallest residual that counts.
_REFUTED, _NOTICED = 1e-2, 1e-8


class _Step(NamedTuple):
    """What was seen at one control step of B rows.

    The ``observations`` (B, nx + nc), the ``actions`` (B, nu), and in which rows the step is the ``first`` (B,) of an
    episode.
    """

    observations: Array
    actions: Array
    first: Bools


@dataclass(frozen=True, eq=False)
class Seen:
    """What was seen of the episodes of B rows so far.

    Args:
        age: control steps since the episode began, (B,); more than are watched where its beginning was not seen.
        steps: the last control steps, as many as a block has.
        over: whether no row is watched any more.
        blocks, periods, rescaled: numbers of blocks so far, and of those that contradict the period and the actions.
    """

    age: Ints
    steps: tuple[_Step, ...] = ()
    over: bool = False
    blocks: int = 0
    periods: int = 0
    rescaled: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class Watched:
    """Recurrent state of ``predict`` for B rows: the ``inner`` one of the policy, and what was ``seen`` so far."""

    inner: State
    seen: Seen

    def __len__(self) -> int:
        return len(self.seen.age)

    @classmethod
    def of(cls, state: State, size: int) -> Watched:
        """The recurrent ``state`` of ``predict`` for ``size`` rows, with what was seen.

        That is nothing where there is no state, and where it is the policy's own, from an episode under way.
        """
        if isinstance(state, cls):
            return state
        return cls(state, Seen(np.full(size, 0 if state is None else LAST + 1), over=state is not None))


class Watch:
    """Watches observations and actions of a policy for ``problem`` at control steps of ``dt`` seconds."""

    def __init__(self, problem: OptimalControlProblem, dt: float) -> None:
        self.problem, self.dt = problem, dt
        self._substeps = runge_kutta_steps(problem, dt)
        x, u, s = problem.symbols()
        constants = {name: ca.SX.sym(name) for name in problem.system.constants}
        rates = problem.system.derivative(x, u, constants)
        other = ca.vertcat(u, s, *constants.values())
        free = [not any(ca.which_depends(rates[i], other, 1)) for i in range(problem.system.nx)]
        moving = [any(ca.which_depends(rates[i], x, 1)) for i in range(problem.system.nx)]
        self._kinematic = np.flatnonzero(np.array(free) & np.array(moving))
        self._kinematic_scale = problem.system.state.scale[self._kinematic]
        chosen = [rates[int(i)] for i in self._kinematic]
        self._rates = BatchFunction(dense_function("kinematics", [x], [ca.vertcat(*chosen)])) if chosen else None

    def restarted(self, seen: Seen, observations: Array, begins: Bools) -> Bools:
        """The rows (B,) in which another episode has begun, of which ``begins`` does not tell.

        They began one control step before, as ``seen`` says, and continue at other ``observations``, (B, nx + nc).
        """
        asked = (seen.age == 1) & ~begins
        if not asked.any():
            return asked
        last = seen.steps[-1]
        (before, context), (after, now) = (split(self.problem, each) for each in (last.observations, observations))
        box, system = self.problem.system.control, self.problem.system
        reach = np.zeros_like(before)
        for control in (last.actions, self.problem.terminal.controls(context), box.lower, box.upper):
            following = self._flow(before, np.broadcast_to(control, last.actions.shape), context)
            reach = np.fmax(reach, np.abs(following - before))
        far = np.abs(system.difference(after, before)) > _MARGIN * reach + _SLACK * system.state.width
        changed = np.abs(now - context) > 1e-6 * self.problem.context.width
        return np.asarray(asked & (far.any(axis=1) | changed.any(axis=1)))

    def following(
        self,
        seen: Seen,
        observations: Array,
        actions: NDArray[np.float32],
        begins: Bools,
        restarted: Bools,
    ) -> Seen:
        """What is ``seen`` after ``actions`` at ``observations`` as well, which may be kept.

        Rows that ``begins`` or ``restarted`` marks are watched anew, as are those of age 0.

        Raises:
            ValueError: the environment has another control period, or other actions.
        """
        age = seen.age
        first = begins | restarted | (age == 0)
        now = _Step(observations, np.array(actions, np.float64), first)
        done = ~first & (age <= LAST) & (age % BLOCK == 0)
        if np.count_nonzero(done):
            seen = self._judged(seen, *self._block((*seen.steps, now), done))
        age = np.where(first, 1, np.minimum(age + 1, LAST + 1))
        age[restarted] = 2  # an episode restarts at most once, whatever follows
        over = not np.count_nonzero(age <= LAST)
        return replace(seen, age=age, steps=() if over else (*seen.steps, now)[-BLOCK:], over=over)

    def _flow(self, states: Array, controls: Array, contexts: Array) -> Array:
        period = np.full((len(states), 1), self.dt)
        return np.asarray(self.problem.functions.flow(self._substeps)(states, controls, contexts, period)[0])

    def _block(self, steps: Sequence[_Step], rows: Bools) -> tuple[Array, Array]:
        """What the block of control steps that ends with the last of ``steps`` tells of m ``rows``, a mask (B,).

        Σ Δx², Σ Δx g̅, Σ g̅² and Σ g̅⁴ of the kinematic coordinates, (m, 4, n), and Σ of the squared scaled residuals
        under given and under rescaled actions, (m, 2).
        """
        before, after = (np.concatenate([step.observations[rows] for step in part]) for part in (steps[:-1], steps[1:]))
        actions = np.concatenate([step.actions[rows] for step in steps[:-1]])
        one_episode = ~np.concatenate([step.first[rows] for step in steps[1:]])
        found = (self._movement(before, after), self._residuals(before, actions, after))
        moved, residual = (
            np.where(one_episode.reshape(-1, *[1] * (each.ndim - 1)), each, 0.0)
            .reshape(len(steps) - 1, -1, *each.shape[1:])
            .sum(axis=0)
            for each in found
        )
        return moved, residual

    def _movement(self, before: Array, after: Array) -> Array:
        """Δx², Δx g̅, g̅² and g̅⁴ of the kinematic coordinates, (B, 4, n)."""
        if self._rates is None:
            return np.zeros((len(before), 4, 0))
        (x, _), (y, _) = split(self.problem, before), split(self.problem, after)
        delta = self.problem.system.difference(y, x)[:, self._kinematic]
        mean = (self._rates(x)[0] + self._rates(y)[0]) / 2
        return np.stack([delta**2, delta * mean, mean**2, mean**4], axis=1)

    def _residuals(self, before: Array, actions: Array, after: Array) -> Array:
        """Squared distances of the state from that under given and under rescaled ``actions``, (B, 2)."""
        (x, context), (now, _) = split(self.problem, before), split(self.problem, after)
        box, scale = self.problem.system.control, self.problem.system.state.scale
        rescaled = np.clip(box.lower + (actions + 1) * box.width / 2, box.lower, box.upper)
        errors = [
            self.problem.system.difference(now, self._flow(x, controls, context)) / scale
            for controls in (actions, rescaled)
        ]
        return np.stack([(error**2).sum(axis=1) for error in errors], axis=1)

    def _judged(self, seen: Seen, moved: Array, residual: Array) -> Seen:
        """``seen`` with the blocks of ``moved`` (m, 4, n) and ``residual`` (m, 2) counted; an error if they tell."""
        with np.errstate(all="ignore"):
            squares, products, rates, fourth = moved.swapaxes(0, 1)
            clear = (products > 0) & (products**2 > _AGREEMENT * squares * rates)
            clear &= (rates**2 > _EFFECTIVE * fourth) & (squares > _NOTICED * self._kinematic_scale**2)
            period = np.sqrt(squares / rates)
            wrong = clear & (np.abs(np.log(period / self.dt)) > np.log(_DEVIATION))
        given, rescaled = residual.T
        other = (given > _NOTICED) & (rescaled < _REFUTED * given)
        blocks = seen.blocks + len(moved)
        periods = seen.periods + int(wrong.any(axis=1).sum())
        actions = seen.rescaled + int(other.sum())
        if wrong.any() and periods >= max(_ALARMS, _FRACTION * blocks):
            raise ValueError(
                f"{self.problem.id}: the observations move as in control steps of {np.median(period[wrong]):.2g} s, "
                f"expected {self.dt} s: make the policy and the environment with the same dt, and run it without "
                "wrappers that change observations or repeat actions (policy.check(env) tells)"
            )
        if other.any() and actions >= max(_ALARMS, _FRACTION * blocks):
            raise ValueError(
                f"{self.problem.id}: the state moves as under actions rescaled from [-1, 1], expected actions in the "
                "units of the control: run the policy without the wrapper that rescales them (policy.check(env) tells)"
            )
        return replace(seen, blocks=blocks, periods=periods, rescaled=actions)
