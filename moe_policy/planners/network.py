"""Networks as planners p → Trajectory.

A plan is returned as it was predicted: its duration is not clipped to the problem's bounds, and its first state need
not be the initial state. The policy that tracks the plan deals with both.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from moe_policy.model_files import Json, ModelFile, Tensors, write_model
from moe_policy.planners.networks import (
    ARGMAX,
    Floats,
    Mixing,
    MixtureOfExperts,
    Network,
    SingleNetwork,
    Softmax,
    check_mixing,
    outputs_of,
    softmax,
)
from moe_policy.planners.record import TrainingReport
from moe_policy.planners.scaling import Standardizer
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_kind
from ocp_envs.support.doors import checked
from ocp_envs.trajectory import Trajectory

if TYPE_CHECKING:
    import casadi as ca
    from torch.nn import Module

#: What the names of a network's tensors begin with in a file.
_NETWORK = "network."


@checked
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
        experts = self.network.experts if isinstance(self.network, MixtureOfExperts) else (self.network,)
        sizes = experts[0].sizes
        check_mixing(self.mixing)
        networks, scalers = (sizes[0], sizes[-1]), (len(self.inputs), len(self.outputs))
        expected = (len(self.problem.parameters), self.problem.flat_size)
        if not networks == scalers == expected:
            wanted = f"expected networks and scalers from {expected[0]} to {expected[1]} values"
            raise ValueError(f"{self.problem.id}: {wanted}, got networks {networks} and scalers {scalers}")

    def _scaled(self, p: ArrayLike) -> tuple[Floats, Array]:
        """Inputs (B, np) of the network, and the whole turns (B, nx) from its plans to those of ``p``."""
        within, turns = self.problem.in_one_turn(p)
        return self.inputs.scale(within).astype(np.float32), turns

    def _trajectory(self, outputs: Floats, turns: Array) -> Trajectory:
        return self.problem.unflatten(self.outputs.unscale(outputs)).shifted(turns)

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), which must be finite; outside their box they are extrapolated.

        The angles of p may be written in any turn; a plan begins in the turn of its p.
        """
        x, turns = self._scaled(p)
        return self._trajectory(outputs_of(self.network, x, self.mixing), turns)

    @property
    def _mixture(self) -> MixtureOfExperts:
        if not isinstance(self.network, MixtureOfExperts):
            raise TypeError(f"{self.name} is a single network and has neither gate nor experts")
        return self.network

    def gate(self, p: ArrayLike) -> tuple[Ints, Array]:
        """The chosen expert (B,) of parameters ``p``, and the gate's probabilities softmax(c) (B, r)."""
        x, _ = self._scaled(p)
        logits = self._mixture.gate(x)
        return logits.argmax(axis=1), softmax(logits)

    def experts(self, p: ArrayLike) -> tuple[Trajectory, ...]:
        """The plans of every expert for parameters ``p``, r batches of B."""
        x, turns = self._scaled(p)
        return tuple(self._trajectory(expert(x), turns) for expert in self._mixture.experts)

    def alternatives(self, p: ArrayLike) -> tuple[Trajectory, ...]:
        """The plans of every expert of a mixture for parameters ``p``, or the only plan of a single network."""
        return self.experts(p) if isinstance(self.network, MixtureOfExperts) else (self(p),)

    def expert_planners(self) -> tuple[NetworkPlanner, ...]:
        """A planner for each expert of a mixture, which uses that expert alone, whatever the gate says.

        Raises:
            TypeError: a single network.
        """
        return tuple(
            NetworkPlanner(self.problem, f"{self.name}, expert {i}", expert, self.inputs, self.outputs)
            for i, expert in enumerate(self._mixture.experts)
        )

    def module(self) -> Module:
        """This planner as a PyTorch module from p (B, np) to flat plans (B, flat_size), for export.

        Its graph, recorded by ``torch.export``, ``torch.onnx`` or ``torch.jit.trace``, is right for every p and every
        batch size; that of a mixture evaluates all experts.
        """
        from moe_policy.planners.graph import PlannerModule  # plans need no PyTorch

        return PlannerModule(self).eval()

    @checked
    def to_onnx(self, path: str | os.PathLike[str]) -> None:
        """Write this planner as an ONNX graph, for runtimes without Python; it needs the package ``onnx``.

        The input ``p`` is (batch, np) in double precision, in any turn and of any batch size; the outputs are ``plan``,
        the flat layout (batch, flat_size), and ``expert``, the index (batch,) of the expert with the largest logit, 0
        for a single network. All experts are evaluated. The model's metadata name the problem and the layout.

        Args:
            path: the file, such as ``"planner.onnx"``.

        Raises:
            ImportError: the package is not installed.
        """
        from moe_policy.planners.onnx_graph import write_onnx  # most programs export nothing

        write_onnx(self, path)

    def to_casadi(self) -> ca.Function:
        """This planner as a CasADi function p (np,) → plan (flat_size,), expert, in double precision.

        It can be differentiated; its derivative is that of the chosen expert where the gate chooses by argmax.
        """
        from moe_policy.planners.casadi_graph import casadi_function

        return casadi_function(self)

    @property
    def parameters_total(self) -> int:
        """Number of weights."""
        return self.network.count

    @property
    def parameters_active(self) -> int:
        """Largest number of weights that take part in one plan: the gate and one expert where argmax chooses."""
        if isinstance(self.network, SingleNetwork) or isinstance(self.mixing, Softmax):
            return self.parameters_total
        return self.network.gate.count + max(expert.count for expert in self.network.experts)

    def rounded(self) -> NetworkPlanner:
        """This planner with weights rounded to half precision, whose files are half as large.

        It calculates in single precision still. Each weight changes by at most 1 part in 2048. The shipped planners are
        rounded like this.
        """
        return replace(self, network=self.network.in_half_precision())

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``<path>.safetensors`` and ``<path>.json``."""
        network = self.network
        if isinstance(network, MixtureOfExperts):
            sizes: Json = {"gate": network.gate.sizes, "experts": [expert.sizes for expert in network.experts]}
        else:
            sizes = {"single": network.sizes}
        tensors: dict[str, NDArray[np.floating]] = {**network.tensors(_NETWORK)}
        for name, scaler in (("inputs", self.inputs), ("outputs", self.outputs)):
            tensors |= {f"{name}.mean": np.asarray(scaler.mean), f"{name}.std": np.asarray(scaler.std)}
        description = {
            "name": self.name,
            "sizes": sizes,
            "mixing": {"softmax": self.mixing.epsilon} if isinstance(self.mixing, Softmax) else {"argmax": None},
            "details": dict(self.details),
        }
        write_model(path, "network", self.problem, tensors, description)


def read_network(file: ModelFile, problem: OptimalControlProblem) -> NetworkPlanner:
    """The planner for ``problem`` that :meth:`NetworkPlanner.save` wrote to ``file``."""
    tensors = file.tensors
    network = _network({key: value for key, value in tensors.items() if key.startswith(_NETWORK)}, file)
    return NetworkPlanner(
        problem,
        file.description["name"],
        network,
        Standardizer(tensors["inputs.mean"], tensors["inputs.std"]),
        Standardizer(tensors["outputs.mean"], tensors["outputs.std"]),
        _mixing(file.description["mixing"]),
        file.description["details"],
    )


def _network(tensors: Tensors, file: ModelFile) -> Network:
    """The network of ``tensors``, which must be those of the sizes that the description in ``file`` names."""
    sizes = file.description["sizes"]
    network: Network
    if sizes.keys() == {"single"}:
        network = SingleNetwork.read(tensors, sizes["single"], _NETWORK)
    elif sizes.keys() == {"gate", "experts"}:
        experts = (SingleNetwork.read(tensors, e, f"{_NETWORK}experts.{i}.") for i, e in enumerate(sizes["experts"]))
        network = MixtureOfExperts(SingleNetwork.read(tensors, sizes["gate"], f"{_NETWORK}gate."), tuple(experts))
    else:
        raise ValueError(f"expected sizes of 'single', or of 'gate' and 'experts'; got {sorted(sizes)}")
    if unknown := sorted(tensors.keys() - network.tensors(_NETWORK).keys()):
        raise ValueError(f"got tensors of layers that the sizes do not name: {unknown}")
    return network


def _mixing(record: Json) -> Mixing:
    """How a mixture combines its experts, from JSON."""
    if record == {"argmax": None}:
        return ARGMAX
    if record.keys() == {"softmax"}:
        return Softmax(record["softmax"])
    raise ValueError(f"expected the mixing 'argmax' (null) or 'softmax' (a number), got {record}")
