"""Networks: shapes and forward passes only.

A single network is a multilayer perceptron with LeakyReLU(0.2) between its layers and a linear output. A mixture of r
experts (Tang & Hauser, section III-C) has a gate c(p) ∈ ℝ^r and regressors y_i(p):

    z(p) = Σ_i P_i(p) y_i(p),   P = softmax(c / ε)   or, in the limit ε → 0,   P_i = 1 for i = argmax c, else 0

With argmax each input goes through the chosen expert alone. A graph cannot be chosen by values: where one is recorded
(``torch.export``, ``torch.onnx.export``, ``torch.jit.trace``) all experts are evaluated, and one output is selected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from moe_policy.planners.calculation import DEVICE, DTYPE
from ocp_envs.support.checks import check_number, check_whole

NEGATIVE_SLOPE = 0.2


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


class SingleNetwork(nn.Module):
    """A multilayer perceptron.

    Args:
        sizes: sizes of all layers, input and output included, such as ``(2, 300, 75)``.
        generator: source of the initial weights, uniform in ±1/√(inputs of the layer) (PyTorch's own default for linear
            layers, drawn without touching the global state); ``None`` leaves them zero, to be loaded.
    """

    def __init__(self, sizes: Sequence[int], generator: torch.Generator | None = None) -> None:
        super().__init__()
        if len(sizes) < 2 or min(sizes) < 1:
            raise ValueError(f"sizes must name at least an input and an output layer, all positive; got {sizes}")
        for size in sizes:
            check_whole("a layer's size", size)
        self.sizes = tuple(int(size) for size in sizes)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for inputs, outputs in zip(self.sizes[:-1], self.sizes[1:]):
            bound = 1 / math.sqrt(inputs)
            for parameters, shape in ((self.weights, (outputs, inputs)), (self.biases, (outputs,))):
                with torch.inference_mode(False):  # such parameters can be trained later
                    values = torch.zeros(shape, dtype=DTYPE, device=DEVICE)
                    if generator is not None:
                        values.uniform_(-bound, bound, generator=generator)
                    parameters.append(nn.Parameter(values))

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (B, sizes[-1]) of inputs ``x`` (B, sizes[0])."""
        last = len(self.weights) - 1
        # Iterating over a ParameterList takes as long as the layers themselves.
        parameters = zip(self.weights._parameters.values(), self.biases._parameters.values())
        for i, (weight, bias) in enumerate(parameters):
            x = F.linear(x, cast(Tensor, weight), bias)
            if i < last:
                x = F.leaky_relu(x, NEGATIVE_SLOPE)
        return x


class MixtureOfExperts(nn.Module):
    """A ``gate`` from inputs to r logits and its r ``experts``, which may have hidden layers of different sizes."""

    def __init__(self, gate: SingleNetwork, experts: Sequence[SingleNetwork]) -> None:
        super().__init__()
        if not experts or gate.sizes[-1] != len(experts):
            raise ValueError(f"a gate with {gate.sizes[-1]} logits needs as many experts, got {len(experts)}")
        sizes = [expert.sizes for expert in experts]
        if {(each[0], each[-1]) for each in sizes} != {(gate.sizes[0], sizes[0][-1])}:
            raise ValueError(f"gate {gate.sizes} and experts {sizes} must share their inputs, experts their outputs")
        self.gate = gate
        self.experts = nn.ModuleList(experts)
        self.outputs = experts[0].sizes[-1]

    def forward(self, x: Tensor, mixing: Mixing) -> Tensor:
        """Outputs (B, R) of inputs ``x`` (B, inputs), combined by ``mixing``."""
        check_mixing(mixing)
        if isinstance(mixing, Softmax) or torch.compiler.is_exporting() or torch.jit.is_tracing():
            return self.from_all_experts(x, mixing)
        return self._from_chosen_experts(x, self.gate(x).argmax(dim=1))

    def from_all_experts(self, x: Tensor, mixing: Mixing) -> Tensor:
        """:meth:`forward` of ``x`` and ``mixing`` by a calculation that does not depend on the values of ``x``: all
        experts are evaluated.
        """
        logits, outputs = self.gate(x), self.all_experts(x)
        if isinstance(mixing, Softmax):
            probabilities = torch.softmax(logits / mixing.epsilon, dim=1)
            return torch.einsum("bk,kbr->br", probabilities, outputs)
        choice = logits.argmax(dim=1)[None, :, None]
        return outputs.gather(0, choice.expand(1, -1, self.outputs))[0]

    def _from_chosen_experts(self, x: Tensor, choice: Tensor) -> Tensor:
        """Outputs (B, R) of the expert ``choice`` (B,) of each input ``x``, from that expert alone."""
        if len(x) == 1:
            return cast(Tensor, self.experts[int(choice)](x))
        sizes = torch.bincount(choice, minlength=len(self.experts)).tolist()
        order = choice.argsort(stable=True)
        parts = [expert(part) for expert, part in zip(self.experts, x[order].split(sizes)) if len(part)]
        return torch.cat(parts)[order.argsort()] if parts else x.new_zeros(0, self.outputs)

    def all_experts(self, x: Tensor) -> Tensor:
        """Predictions of every expert, (r, B, R), of inputs ``x`` (B, inputs)."""
        return torch.stack([expert(x) for expert in self.experts])


def count_parameters(module: nn.Module) -> int:
    """Number of trainable values of ``module``."""
    return sum(parameter.numel() for parameter in module.parameters())


Network = SingleNetwork | MixtureOfExperts


def outputs_of(network: Network, x: Tensor, mixing: Mixing) -> Tensor:
    """Outputs (B, R) of inputs ``x`` (B, inputs) from a ``network`` of either kind; ``mixing`` is for mixtures."""
    return network(x, mixing) if isinstance(network, MixtureOfExperts) else network(x)
