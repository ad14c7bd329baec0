"""Networks of :mod:`moe_policy.planners.networks` as PyTorch modules, which can be trained and exported.

A graph cannot be chosen by values: where one is recorded (``torch.export``, ``torch.onnx.export``,
``torch.jit.trace``) all experts of a mixture are evaluated, and one output is selected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from moe_policy.planners.calculation import DEVICE, DTYPE, training
from moe_policy.planners.networks import (
    NEGATIVE_SLOPE,
    Mixing,
    MixtureOfExperts,
    Network,
    SingleNetwork,
    Softmax,
    check_mixing,
    check_mixture,
)
from ocp_envs.support.checks import check_whole


class SingleModule(nn.Module):
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

    def network(self) -> SingleNetwork:
        """The network with the present weights."""
        weights, biases = (
            tuple(value.detach().to("cpu", DTYPE).numpy() for value in values) for values in (self.weights, self.biases)
        )
        return SingleNetwork(weights, biases)


class MixtureModule(nn.Module):
    """A ``gate`` from inputs to r logits and its r ``experts``, which may have hidden layers of different sizes."""

    def __init__(self, gate: SingleModule, experts: Sequence[SingleModule]) -> None:
        super().__init__()
        check_mixture(gate.sizes, [expert.sizes for expert in experts])
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
        sizes = torch.bincount(choice, minlength=len(self.experts)).tolist()
        order = choice.argsort(stable=True)
        parts = [expert(part) for expert, part in zip(self.experts, x[order].split(sizes)) if len(part)]
        return torch.cat(parts)[order.argsort()] if parts else x.new_zeros(0, self.outputs)

    def all_experts(self, x: Tensor) -> Tensor:
        """Predictions of every expert, (r, B, R), of inputs ``x`` (B, inputs)."""
        return torch.stack([expert(x) for expert in self.experts])

    def network(self) -> MixtureOfExperts:
        """The mixture with the present weights."""
        experts = tuple(cast(SingleModule, expert).network() for expert in self.experts)
        return MixtureOfExperts(self.gate.network(), experts)


Module = SingleModule | MixtureModule


def module_of(network: Network) -> Module:
    """A module with copies of the weights of ``network``, which can be trained."""
    if isinstance(network, MixtureOfExperts):
        return MixtureModule(_single(network.gate), [_single(expert) for expert in network.experts])
    return _single(network)


def _single(network: SingleNetwork) -> SingleModule:
    module = SingleModule(network.sizes)
    with training():
        module.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in network.tensors().items()})
    return module


def outputs_of(module: Module, x: Tensor, mixing: Mixing) -> Tensor:
    """Outputs (B, R) of inputs ``x`` (B, inputs) from a ``module`` of either kind; ``mixing`` is for mixtures."""
    outputs = module(x, mixing) if isinstance(module, MixtureModule) else module(x)
    return cast(Tensor, outputs)
