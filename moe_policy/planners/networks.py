"""Networks as values: their weights, and the forward pass in NumPy.

A single network is a multilayer perceptron with LeakyReLU(0.2) between its layers and a linear output. A mixture of r
experts (Tang & Hauser, section III-C) has a gate c(p) ∈ ℝ^r and regressors y_i(p):

    z(p) = Σ_i P_i(p) y_i(p),   P = softmax(c / ε)   or, in the limit ε → 0,   P_i = 1 for i = argmax c, else 0

With argmax each input goes through the chosen expert alone. Everything is in single precision. PyTorch trains networks
(:mod:`moe_policy.planners.modules`) and is not needed here: for networks of these sizes a call of PyTorch takes longer
than the calculation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from moe_policy.model_files import Tensors, in_half_precision
from ocp_envs.support.arrays import Array, Ints, frozen_array
from ocp_envs.support.checks import check_kind, check_number
from ocp_envs.support.doors import checked

NEGATIVE_SLOPE = 0.2
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Argmax:
    """The expert with the largest logit alone; no gradient reaches the gate."""


@dataclass(frozen=True)
class Softmax:
    """All experts, weighted by softmax(c / ε); ``epsilon`` = ε > 0."""

    epsilon: float = 1.0

    def __post_init__(self) -> None:
        check_number("epsilon", self.epsilon, "a positive number, whose limit 0 is Argmax()", 0.0)


Mixing = Argmax | Softmax
ARGMAX = Argmax()


def check_mixing(mixing: object) -> None:
    """Refuse with a TypeError a ``mixing`` that is neither ``Argmax()`` nor ``Softmax(ε)``."""
    if not isinstance(mixing, (Argmax, Softmax)):
        raise TypeError(f"expected Argmax() or Softmax(epsilon) of moe_policy as mixing, got {mixing!r}")


def checked_layers(weights: object, biases: object) -> tuple[tuple[Floats, ...], tuple[Floats, ...]]:
    """Read-only copies, in single precision, of the ``weights`` (outputs, inputs) and ``biases`` (outputs,) of layers.

    Raises:
        TypeError: no sequences.
        ValueError: no layers, or layers that do not fit together.
    """
    check_kind("weights", weights, Sequence)
    check_kind("biases", biases, Sequence)
    w, b = (tuple(frozen_array(each, np.float32) for each in cast(Sequence[Floats], v)) for v in (weights, biases))
    shapes = [weight.shape for weight in w], [bias.shape for bias in b]
    if not w or any(weight.ndim != 2 or not weight.size for weight in w):
        raise ValueError(f"expected weights (outputs, inputs) of at least one layer, got {shapes[0]}")
    inputs = [shape[1] for shape in shapes[0][1:]]
    if shapes[1] != [shape[:1] for shape in shapes[0]] or inputs != [shape[0] for shape in shapes[0][:-1]]:
        raise ValueError(f"weights {shapes[0]} and biases {shapes[1]} do not fit together")
    return w, b


def forward(
    weights: Sequence[Floats], biases: Sequence[Floats], activation: Callable[[Floats], Floats], x: Floats
) -> Floats:
    """W_L σ(… σ(W_1 x + b_1) …) + b_L, (B, outputs), of the ``weights`` W, the ``biases`` b and the ``activation`` σ at
    inputs ``x`` (B, inputs).
    """
    last = len(weights) - 1
    for i, (weight, bias) in enumerate(zip(weights, biases)):
        x = x @ weight.T
        x += bias
        if i < last:
            x = activation(x)
    return x


def _leaky_relu(x: Floats) -> Floats:
    return np.maximum(x, NEGATIVE_SLOPE * x)


@checked
@dataclass(frozen=True, eq=False)
class SingleNetwork:
    """A multilayer perceptron.

    Args:
        weights: those of every layer, each (outputs, inputs); kept in single precision.
        biases: those of every layer, each (outputs,).

    Raises:
        ValueError: no layers, or layers that do not fit together.
    """

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def __post_init__(self) -> None:
        for name, values in zip(("weights", "biases"), checked_layers(self.weights, self.biases)):
            object.__setattr__(self, name, values)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of all layers, input and output included, such as ``(2, 300, 75)``."""
        return (int(self.weights[0].shape[1]), *(len(weight) for weight in self.weights))

    @property
    def count(self) -> int:
        """Number of weights and biases."""
        return sum(each.size for each in (*self.weights, *self.biases))

    def __call__(self, x: Floats) -> Floats:
        """Outputs (B, sizes[-1]) of inputs ``x`` (B, sizes[0])."""
        return forward(self.weights, self.biases, _leaky_relu, x)

    def in_half_precision(self) -> SingleNetwork:
        """The network with weights and biases rounded to half precision; it calculates in single precision still."""
        return SingleNetwork(*(tuple(map(in_half_precision, values)) for values in (self.weights, self.biases)))

    def tensors(self, prefix: str = "") -> dict[str, Floats]:
        """Weights and biases by name, each name after ``prefix``."""
        return {
            f"{prefix}{kind}.{i}": value
            for kind, values in (("weights", self.weights), ("biases", self.biases))
            for i, value in enumerate(values)
        }

    @classmethod
    def read(cls, tensors: Tensors, sizes: Sequence[int], prefix: str = "") -> SingleNetwork:
        """The network of ``sizes`` whose :meth:`tensors` with ``prefix`` are among ``tensors``.

        Raises:
            KeyError: a tensor is missing.
            ValueError: they are those of other sizes.
        """
        layers = range(len(sizes) - 1)
        weights, biases = ([tensors[f"{prefix}{kind}.{i}"] for i in layers] for kind in ("weights", "biases"))
        network = cls(tuple(weights), tuple(biases))
        if network.sizes != tuple(sizes):
            raise ValueError(f"expected layers of sizes {tuple(sizes)}, got {network.sizes}")
        return network


@dataclass(frozen=True, eq=False)
class MixtureOfExperts:
    """A ``gate`` from inputs to r logits and its r ``experts``, which may have hidden layers of different sizes."""

    gate: SingleNetwork
    experts: tuple[SingleNetwork, ...]

    def __post_init__(self) -> None:
        check_kind("experts", self.experts, Sequence)
        object.__setattr__(self, "experts", tuple(self.experts))
        for network in (self.gate, *self.experts):
            check_kind("gate and experts", network, SingleNetwork)
        check_mixture(self.gate.sizes, [expert.sizes for expert in self.experts])

    @property
    def count(self) -> int:
        """Number of weights and biases."""
        return self.gate.count + sum(expert.count for expert in self.experts)

    def __call__(self, x: Floats, mixing: Mixing) -> Floats:
        """Outputs (B, R) of inputs ``x`` (B, inputs), combined by ``mixing``."""
        check_mixing(mixing)
        logits = self.gate(x)
        if isinstance(mixing, Softmax):
            probabilities = softmax(logits / mixing.epsilon).astype(np.float32)
            return np.asarray(np.einsum("bk,kbr->br", probabilities, self.all_experts(x)))
        return self._from_chosen_experts(x, logits.argmax(axis=1))

    def _from_chosen_experts(self, x: Floats, choice: Ints) -> Floats:
        """Outputs (B, R) of the expert ``choice`` (B,) of each input ``x``, from that expert alone."""
        if len(x) == 1:
            return self.experts[choice[0]](x)
        outputs = np.empty((len(x), self.experts[0].sizes[-1]), np.float32)
        for i, expert in enumerate(self.experts):
            rows = np.flatnonzero(choice == i)
            if len(rows):
                outputs[rows] = expert(x[rows])
        return outputs

    def all_experts(self, x: Floats) -> Floats:
        """Predictions of every expert, (r, B, R), of inputs ``x`` (B, inputs)."""
        return np.stack([expert(x) for expert in self.experts])

    def in_half_precision(self) -> MixtureOfExperts:
        """The mixture with gate and experts :meth:`SingleNetwork.in_half_precision`."""
        return MixtureOfExperts(
            self.gate.in_half_precision(), tuple(expert.in_half_precision() for expert in self.experts)
        )

    def tensors(self, prefix: str = "") -> dict[str, Floats]:
        """Weights and biases by name, each name after ``prefix``."""
        found = self.gate.tensors(f"{prefix}gate.")
        for i, expert in enumerate(self.experts):
            found |= expert.tensors(f"{prefix}experts.{i}.")
        return found


Network = SingleNetwork | MixtureOfExperts


def check_mixture(gate: Sequence[int], experts: Sequence[Sequence[int]]) -> None:
    """Refuse with a ValueError layer sizes of a ``gate`` and of ``experts`` that make no mixture."""
    if not experts or gate[-1] != len(experts):
        raise ValueError(f"a gate with {gate[-1]} logits needs as many experts, got {len(experts)}")
    if {(each[0], each[-1]) for each in experts} != {(gate[0], experts[0][-1])}:
        raise ValueError(f"gate {gate} and experts {list(experts)} must share their inputs, experts their outputs")


def softmax(logits: Floats) -> Array:
    """exp(c) / Σ exp(c) of the rows of ``logits`` c (B, r), in double precision."""
    exponentials = np.exp(np.float64(logits - logits.max(axis=1, keepdims=True)))
    return np.asarray(exponentials / exponentials.sum(axis=1, keepdims=True))


def outputs_of(network: Network, x: Floats, mixing: Mixing) -> Floats:
    """Outputs (B, R) of inputs ``x`` (B, inputs) from a ``network`` of either kind; ``mixing`` is for mixtures."""
    return network(x, mixing) if isinstance(network, MixtureOfExperts) else network(x)
