"""Policies trained by reinforcement learning: an actor network that acts at its own period.

    a = squash(W_L σ(… σ(W_1 φ(observation) + b_1) …) + b_L),   u = the control that a ∈ [-1, 1] represents

with φ and the scaling of :mod:`moe_policy.rl.features`; σ and squash are ReLU and tanh for SAC, tanh and a clip
for PPO. The actor decides every ``period`` seconds and its control is held in between, so a policy trained with
ten decisions a second acts in an environment with fifty control steps a second. Running it needs torch, but not
Stable-Baselines3.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor, nn

from moe_policy.control.policy import ModelPolicy
from moe_policy.model_files import ModelFile, write_model
from moe_policy.planners.calculation import DEVICE, DTYPE, planning
from moe_policy.rl.features import Actions, Features
from ocp_envs.control_step import checked_dt
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Bools, Ints

ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "tanh": nn.Tanh}
SQUASHES: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "clip": nn.Hardtanh}


class Actor(nn.Module):
    """The mean action of a policy: features (B, n) → actions (B, nu) in [-1, 1].

    ``sizes`` are the neurons of every layer, features first and actions last; ``activation`` is that of the hidden
    layers, ``"relu"`` or ``"tanh"``; ``squash`` maps actions to [-1, 1], ``"tanh"`` or ``"clip"``.

    Raises:
        ValueError: fewer than two sizes, or an unknown activation or squash.
    """

    def __init__(self, sizes: Sequence[int], activation: str, squash: str) -> None:
        super().__init__()
        if len(sizes) < 2 or activation not in ACTIVATIONS or squash not in SQUASHES:
            raise ValueError(
                f"expected at least two sizes, an activation of {sorted(ACTIVATIONS)} and a squash of "
                f"{sorted(SQUASHES)}; got {list(sizes)}, {activation!r}, {squash!r}"
            )
        self.sizes, self.activation, self.squash = tuple(int(n) for n in sizes), activation, squash
        self.layers = nn.ModuleList(
            nn.Linear(a, b, device=DEVICE, dtype=DTYPE) for a, b in zip(self.sizes[:-1], self.sizes[1:])
        )
        self._hidden, self._last = ACTIVATIONS[activation](), SQUASHES[squash]()

    def forward(self, features: Tensor) -> Tensor:
        for layer in self.layers[:-1]:
            features = self._hidden(layer(features))
        return self._last(self.layers[-1](features))

    @classmethod
    def of_layers(cls, layers: Sequence[nn.Linear], activation: str, squash: str) -> Actor:
        """An actor with copies of the weights of ``layers``, with the ``activation`` and ``squash`` of the class."""
        actor = cls([layers[0].in_features, *(layer.out_features for layer in layers)], activation, squash)
        for own, given in zip(actor.layers, layers):
            own.load_state_dict(given.state_dict())
        return actor


@dataclass(frozen=True, eq=False)
class Held:
    """Recurrent state of :class:`LearnedPolicy`: ``controls`` (B, nu), held for ``steps_left`` (B,) control steps."""

    controls: Array
    steps_left: Ints


class LearnedPolicy(ModelPolicy):
    """An actor as a policy, with the signature of Stable-Baselines3. A NaN in an observation gives NaN.

    Args:
        problem: the problem of the environment.
        actor: features → actions.
        period: seconds between two decisions, a multiple of ``dt``.
        dt: control period of the environment, seconds.
        algorithm: the learner that trained the actor, such as ``"sac"``.
        details: how it was trained, as JSON.

    Raises:
        ValueError: an actor of other sizes than the problem's, or a period that is no multiple of ``dt``.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        actor: Actor,
        *,
        period: float,
        dt: float = 0.02,
        algorithm: str = "sac",
        details: Mapping[str, object] | None = None,
    ) -> None:
        self._features, self._actions = Features(problem), Actions(problem)
        expected = (self._features.size, problem.system.nu)
        if (actor.sizes[0], actor.sizes[-1]) != expected:
            wanted = f"from {expected[0]} features to {expected[1]} actions"
            raise ValueError(f"{problem.id}: expected an actor {wanted}, got layers of {actor.sizes}")
        self._steps = _whole_steps(problem, period, dt)
        self.problem, self.actor, self.period, self.dt = problem, actor.eval(), float(period), float(dt)
        self.algorithm, self.details = algorithm, dict(details or {})

    @property
    def parameters_total(self) -> int:
        return sum(p.numel() for p in self.actor.parameters())

    parameters_active = parameters_total  # every decision uses all weights

    def at(self, dt: float) -> LearnedPolicy:
        """The same policy for environments with another control period ``dt``, seconds."""
        return LearnedPolicy(
            self.problem, self.actor, period=self.period, dt=dt, algorithm=self.algorithm, details=self.details
        )

    def controls(self, observation: ArrayLike) -> Array:
        """Controls (B, nu) that the actor decides at an ``observation`` (B, nx + nc)."""
        with planning():
            actions = self.actor(torch.from_numpy(self._features(observation)))
        return self._actions.controls(actions.numpy())

    def act(self, observations: NDArray[np.floating], state: Held | None, begins: Bools) -> tuple[Array, Held]:
        size = len(observations)
        if state is None:
            state = Held(np.zeros((size, self.problem.system.nu)), np.zeros(size, np.int64))
        elif len(state.steps_left) != size:
            raise ValueError(f"got {size} observations with the recurrent state of {len(state.steps_left)} episodes")
        due = (state.steps_left == 0) | begins
        controls, steps_left = state.controls, np.where(due, self._steps, state.steps_left) - 1
        if due.any():
            controls = controls.copy()
            controls[due] = self.controls(observations[due])
        return controls.copy(), Held(controls, steps_left)

    def __repr__(self) -> str:
        layers = "-".join(map(str, self.actor.sizes))
        return f"LearnedPolicy({self.problem.id!r}, {self.algorithm!r}, layers {layers}, {self.period} s, dt={self.dt})"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the files ``path`` + ``.safetensors`` and ``.json``; :func:`moe_policy.load_file` reads them."""
        tensors = {name: tensor.detach().numpy() for name, tensor in self.actor.state_dict().items()}
        description = {
            "algorithm": self.algorithm,
            "sizes": list(self.actor.sizes),
            "activation": self.actor.activation,
            "squash": self.actor.squash,
            "period": self.period,
            "details": self.details,
        }
        write_model(path, "rl", self.problem, tensors, description)


def _whole_steps(problem: OptimalControlProblem, period: float, dt: float) -> int:
    steps = period / checked_dt(problem, dt)
    if not (math.isfinite(steps) and round(steps) >= 1 and math.isclose(steps, round(steps), rel_tol=1e-6)):
        wrong = f"the policy decides every {period} s, which is no multiple of the control period of {dt} s"
        raise ValueError(f"{problem.id}: {wrong}")
    return round(steps)


def read_policy(file: ModelFile, problem: OptimalControlProblem) -> LearnedPolicy:
    """The policy that :meth:`LearnedPolicy.save` wrote to ``file``, for ``problem`` and its usual control period."""
    description = file.description
    with torch.device("meta"):  # nothing is allocated before the sizes are known to be those of the tensors
        actor = Actor(description["sizes"], description["activation"], description["squash"])
    state = {name: torch.from_numpy(np.array(value, dtype=np.float32)) for name, value in file.tensors.items()}
    actor.load_state_dict(state, assign=True)
    return LearnedPolicy(
        problem,
        actor,
        period=description["period"],
        algorithm=description["algorithm"],
        details=description["details"],
    )
