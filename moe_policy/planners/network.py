"""Networks as planners p → Trajectory.

A plan is returned as it was predicted: its duration is not clipped to the problem's bounds, and its first state need
not be the initial state. The policy that tracks the plan deals with both.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from moe_policy.model_files import Json, ModelFile, write_model
from moe_policy.planners.calculation import planning
from moe_policy.planners.graph import PlannerModule
from moe_policy.planners.networks import (
    ARGMAX,
    Mixing,
    MixtureOfExperts,
    Network,
    SingleNetwork,
    Softmax,
    check_mixing,
    count_parameters,
    outputs_of,
)
from moe_policy.planners.record import TrainingReport
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_kind
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class NetworkPlanner:
    """A single network or a mixture of experts, with the scalers of its training split.

    Args:
        problem: what it plans for.
        name: short name for tables.
        network: from standardised p to standardised flat trajectories, float32.
        inputs: scaler of p, (np,).
        outputs: scaler of flat trajectories, (flat_size,).
        mixing: how a mixture combines its experts; a single network ignores it.
        details: how it was made, as JSON: settings, seed, clusters, summary of the training.
        report: the full record of the training; not saved, ``None`` after loading.
    """

    problem: OptimalControlProblem
    name: str
    network: Network
    inputs: Standardizer
    outputs: Standardizer
    mixing: Mixing = ARGMAX
    details: Json = field(default_factory=dict)
    report: TrainingReport | None = None

    def __repr__(self) -> str:
        experts = len(self.network.experts) if isinstance(self.network, MixtureOfExperts) else 0
        kind = f"mixture of {experts} experts" if experts else "single network"
        return f"NetworkPlanner({self.problem.id!r}, {self.name!r}, {kind}, {self.parameters_total} weights)"

    def __post_init__(self) -> None:
        check_kind("network", self.network, (SingleNetwork, MixtureOfExperts))
        for name in ("inputs", "outputs"):
            check_kind(name, getattr(self, name), Standardizer)
        # The experts of a mixture have the same inputs and outputs.
        experts = self.network.experts if isinstance(self.network, MixtureOfExperts) else [self.network]
        sizes = cast(SingleNetwork, experts[0]).sizes
        check_mixing(self.mixing)
        networks, scalers = (sizes[0], sizes[-1]), (len(self.inputs), len(self.outputs))
        expected = (len(self.problem.parameters), self.problem.flat_size)
        if not networks == scalers == expected:
            wanted = f"expected networks and scalers from {expected[0]} to {expected[1]} values"
            raise ValueError(f"{self.problem.id}: {wanted}, got networks {networks} and scalers {scalers}")

    def _scaled(self, p: ArrayLike) -> tuple[torch.Tensor, Array]:
        """Inputs (B, np) of the network, and the whole turns (B, nx) from its plans to those of ``p``."""
        within, turns = self.problem.in_one_turn(p)
        weight = self._first.weights[0]
        return torch.from_numpy(self.inputs.scale(within)).to(weight.device, weight.dtype), turns

    def _trajectory(self, outputs: torch.Tensor, turns: Array) -> Trajectory:
        return self.problem.unflatten(self.outputs.unscale(_array(outputs))).shifted(turns)

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), which must be finite; outside their box they are extrapolated.

        The angles of p may be written in any turn; a plan begins in the turn of its p.
        """
        x, turns = self._scaled(p)
        with planning(x.device):
            return self._trajectory(outputs_of(self.network, x, self.mixing), turns)

    @property
    def _first(self) -> SingleNetwork:
        """The network that sees the inputs first."""
        return self.network.gate if isinstance(self.network, MixtureOfExperts) else self.network

    @property
    def _mixture(self) -> MixtureOfExperts:
        if not isinstance(self.network, MixtureOfExperts):
            raise TypeError(f"{self.name} is a single network and has neither gate nor experts")
        return self.network

    def gate(self, p: ArrayLike) -> tuple[Ints, Array]:
        """The chosen expert (B,) of parameters ``p``, and the gate's probabilities softmax(c) (B, r)."""
        x, _ = self._scaled(p)
        with planning(x.device):
            logits = self._mixture.gate(x).cpu()
            return logits.argmax(dim=1).numpy(), torch.softmax(logits.double(), dim=1).numpy()

    def experts(self, p: ArrayLike) -> tuple[Trajectory, ...]:
        """The plans of every expert for parameters ``p``, r batches of B."""
        x, turns = self._scaled(p)
        with planning(x.device):
            return tuple(self._trajectory(outputs, turns) for outputs in self._mixture.all_experts(x))

    def expert_planners(self) -> tuple[NetworkPlanner, ...]:
        """A planner for each expert of a mixture, which uses that expert alone, whatever the gate says.

        Raises:
            TypeError: a single network.
        """
        experts = cast(Iterable[SingleNetwork], self._mixture.experts)
        return tuple(
            NetworkPlanner(self.problem, f"{self.name}, expert {i}", expert, self.inputs, self.outputs)
            for i, expert in enumerate(experts)
        )

    def module(self) -> torch.nn.Module:
        """This planner as a PyTorch module from p (B, np) to flat plans (B, flat_size), for export.

        Its graph, recorded by ``torch.export``, ``torch.onnx`` or ``torch.jit.trace``, is right for every p and every
        batch size; that of a mixture evaluates all experts.
        """
        return PlannerModule(self).eval()

    @property
    def parameters_total(self) -> int:
        """Number of weights."""
        return count_parameters(self.network)

    @property
    def parameters_active(self) -> int:
        """Largest number of weights that take part in one plan: the gate and one expert where argmax chooses."""
        if isinstance(self.network, SingleNetwork) or isinstance(self.mixing, Softmax):
            return self.parameters_total
        return count_parameters(self.network.gate) + max(count_parameters(e) for e in self.network.experts)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``<path>.safetensors`` and ``<path>.json``."""
        network = self.network
        if isinstance(network, MixtureOfExperts):
            sizes: Json = {"gate": network.gate.sizes, "experts": [e.sizes for e in network.experts]}
        else:
            sizes = {"single": network.sizes}
        tensors = {f"network.{key}": value.detach().cpu().numpy() for key, value in network.state_dict().items()}
        for name, scaler in (("inputs", self.inputs), ("outputs", self.outputs)):
            tensors |= {f"{name}.mean": np.asarray(scaler.mean), f"{name}.std": np.asarray(scaler.std)}
        description = {
            "name": self.name,
            "sizes": sizes,
            "mixing": {"softmax": self.mixing.epsilon} if isinstance(self.mixing, Softmax) else {"argmax": None},
            "details": dict(self.details),
        }
        write_model(path, "network", self.problem, tensors, description)


def _array(outputs: torch.Tensor) -> NDArray[np.floating]:
    """The values of ``outputs`` of any type on any device."""
    plain = outputs.device.type == "cpu" and outputs.dtype is torch.float32
    return np.asarray((outputs if plain else outputs.to("cpu", torch.float64)).numpy())


def read_network(file: ModelFile, problem: OptimalControlProblem) -> NetworkPlanner:
    """The planner for ``problem`` that :meth:`NetworkPlanner.save` wrote to ``file``."""
    tensors, prefix = file.tensors, "network."
    with torch.device("meta"):  # nothing is allocated before the sizes are known to be those of the tensors
        network = _network(file.description["sizes"])
    state = {
        key.removeprefix(prefix): torch.from_numpy(np.array(value, dtype=np.float32))
        for key, value in tensors.items()
        if key.startswith(prefix)
    }
    network.load_state_dict(state, assign=True)
    return NetworkPlanner(
        problem,
        file.description["name"],
        network,
        Standardizer(tensors["inputs.mean"], tensors["inputs.std"]),
        Standardizer(tensors["outputs.mean"], tensors["outputs.std"]),
        _mixing(file.description["mixing"]),
        file.description["details"],
    )


def _network(sizes: Json) -> Network:
    """A network of these ``sizes``, as JSON."""
    if sizes.keys() == {"single"}:
        return SingleNetwork(sizes["single"])
    if sizes.keys() == {"gate", "experts"}:
        return MixtureOfExperts(SingleNetwork(sizes["gate"]), [SingleNetwork(each) for each in sizes["experts"]])
    raise ValueError(f"expected sizes of 'single', or of 'gate' and 'experts'; got {sorted(sizes)}")


def _mixing(record: Json) -> Mixing:
    """How a mixture combines its experts, from JSON."""
    if record == {"argmax": None}:
        return ARGMAX
    if record.keys() == {"softmax"}:
        return Softmax(record["softmax"])
    raise ValueError(f"expected the mixing 'argmax' (null) or 'softmax' (a number), got {record}")
