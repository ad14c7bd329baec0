"""Policies trained by reinforcement learning: an actor network that acts at its own period.

    a = squash(W_L σ(… σ(W_1 φ(observation) + b_1) …) + b_L),   u = the control that a ∈ [-1, 1] represents

with φ and the controls of :mod:`moe_policy.rl.encoding`; σ and squash are ReLU and tanh for SAC, tanh and a clip
for PPO. The actor decides every ``period`` seconds and its control is held in between, so a policy trained with
ten decisions a second acts in an environment with fifty control steps a second. Running it needs neither
PyTorch nor Stable-Baselines3.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.control.policy import ModelPolicy
from moe_policy.model_files import ModelFile, write_model
from moe_policy.planners.networks import Floats, checked_layers, forward
from moe_policy.rl.encoding import Encoding, actions_of, features_of, stored_encoding
from ocp_envs.control_step import checked_dt
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from torch.nn import Linear

_Function = Callable[[Floats], Floats]
#: What a layer's weights and biases are called by PyTorch, and in files.
_TENSORS = ("weight", "bias")
#: Activations of the hidden layers, and maps of actions to [-1, 1], by name.
ACTIVATIONS: Mapping[str, _Function] = MappingProxyType({"relu": lambda x: np.maximum(x, 0), "tanh": np.tanh})
SQUASHES: Mapping[str, _Function] = MappingProxyType({"tanh": np.tanh, "clip": lambda x: np.clip(x, -1, 1)})


@checked
@dataclass(frozen=True, eq=False)
class Actor:
    """The mean action of a policy: features (B, n) → actions (B, nu) in [-1, 1], in single precision.

    Args:
        weights: those of every layer, each (outputs, inputs).
        biases: those of every layer, each (outputs,).
        activation: that of the hidden layers, ``"relu"`` or ``"tanh"``.
        squash: maps actions to [-1, 1], ``"tanh"`` or ``"clip"``.

    Raises:
        ValueError: no layers, layers that do not fit together, or an unknown activation or squash.
    """

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]
    activation: str
    squash: str

    def __post_init__(self) -> None:
        for name, values in zip(("weights", "biases"), checked_layers(self.weights, self.biases)):
            object.__setattr__(self, name, values)
        if self.activation not in ACTIVATIONS or self.squash not in SQUASHES:
            raise ValueError(
                f"expected an activation of {sorted(ACTIVATIONS)} and a squash of {sorted(SQUASHES)}; "
                f"got {self.activation!r} and {self.squash!r}"
            )

    @property
    def sizes(self) -> tuple[int, ...]:
        """The neurons of every layer, features first and actions last."""
        return (int(self.weights[0].shape[1]), *(len(weight) for weight in self.weights))

    @property
    def count(self) -> int:
        """Number of weights and biases."""
        return sum(values.size for values in (*self.weights, *self.biases))

    def __call__(self, features: Floats) -> Floats:
        """Actions (B, nu) of ``features`` (B, n)."""
        return SQUASHES[self.squash](forward(self.weights, self.biases, ACTIVATIONS[self.activation], features))

    @classmethod
    def of_layers(cls, layers: Sequence[Linear], activation: str, squash: str) -> Actor:
        """An actor with copies of the weights of PyTorch's ``layers``, with the ``activation`` and ``squash`` of the
        class.
        """
        weights, biases = ([getattr(layer, name).detach().cpu().numpy() for layer in layers] for name in _TENSORS)
        return cls(tuple(weights), tuple(biases), activation, squash)


@checked
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
        encoding: what distinguishes its features and actions from the plain ones; by default nothing.

    Raises:
        ValueError: an actor of other sizes than the problem's, or a period that is no multiple of ``dt``.
    """

    recurrent = Held

    @checked
    def __init__(
        self,
        problem: ProblemOrId,
        actor: Actor,
        *,
        period: float,
        dt: float = 0.02,
        algorithm: str = "sac",
        details: Mapping[str, object] | None = None,
        encoding: Encoding | None = None,
    ) -> None:
        problem = problem_of(problem)
        self.encoding = Encoding() if encoding is None else encoding
        self._features, self._actions = features_of(problem, self.encoding), actions_of(problem, self.encoding)
        expected = (self._features.size, problem.system.nu)
        if (actor.sizes[0], actor.sizes[-1]) != expected:
            wanted = f"from {expected[0]} features to {expected[1]} actions"
            raise ValueError(f"{problem.id}: expected an actor {wanted}, got layers of {actor.sizes}")
        self._steps = _whole_steps(problem, period, dt)
        self.problem, self.actor, self.period, self.dt = problem, actor, float(period), float(dt)
        self.algorithm, self.details = algorithm, dict(details or {})

    @property
    def parameters_total(self) -> int:
        return self.actor.count

    parameters_active = parameters_total  # every decision uses all weights

    @checked
    def at(self, dt: float) -> LearnedPolicy:
        """The same policy for environments with another control period ``dt``, seconds."""
        return LearnedPolicy(
            self.problem,
            self.actor,
            period=self.period,
            dt=dt,
            algorithm=self.algorithm,
            details=self.details,
            encoding=self.encoding,
        )

    @checked
    def controls(self, observation: ArrayLike) -> Array:
        """Controls (B, nu) that the actor decides at an ``observation`` (B, nx + nc)."""
        return self._actions.controls(self.actor(self._features(observation)))

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

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the files ``path`` + ``.safetensors`` and ``.json``; :func:`moe_policy.load_file` reads them."""
        tensors = {
            f"layers.{i}.{name}": values
            for i, layer in enumerate(zip(self.actor.weights, self.actor.biases))
            for name, values in zip(_TENSORS, layer)
        }
        description = {
            "algorithm": self.algorithm,
            "sizes": list(self.actor.sizes),
            "activation": self.actor.activation,
            "squash": self.actor.squash,
            "period": self.period,
            "details": self.details,
        }
        write_model(path, "rl", self.problem, {**tensors, **self.encoding.tensors}, description)


def _whole_steps(problem: OptimalControlProblem, period: float, dt: float) -> int:
    steps = period / checked_dt(problem, dt)
    if not (math.isfinite(steps) and round(steps) >= 1 and math.isclose(steps, round(steps), rel_tol=1e-6)):
        wrong = f"the policy decides every {period} s, which is no multiple of the control period of {dt} s"
        raise ValueError(f"{problem.id}: {wrong}")
    return round(steps)


def read_policy(file: ModelFile, problem: OptimalControlProblem) -> LearnedPolicy:
    """The policy that :meth:`LearnedPolicy.save` wrote to ``file``, for ``problem`` and its usual control period."""
    description = file.description
    sizes, tensors = tuple(description["sizes"]), file.tensors
    weights, biases = (tuple(tensors[f"layers.{i}.{name}"] for i in range(len(sizes) - 1)) for name in _TENSORS)
    actor = Actor(weights, biases, description["activation"], description["squash"])
    encoding = stored_encoding(tensors)
    if actor.sizes != sizes or len(tensors) != len(weights) + len(biases) + len(encoding.tensors):
        raise ValueError(f"expected layers of sizes {sizes}, got {actor.sizes} and the tensors {sorted(tensors)}")
    return LearnedPolicy(
        problem,
        actor,
        period=description["period"],
        algorithm=description["algorithm"],
        details=description["details"],
        encoding=encoding,
    )
