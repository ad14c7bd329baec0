"""A network planner as one PyTorch module, whose graph can be exported."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from moe_policy.planners.arrays import PlannerArrays
from moe_policy.planners.modules import MixtureModule, Module, module_of

if TYPE_CHECKING:
    from moe_policy.planners.network import NetworkPlanner


class PlannerModule(nn.Module):
    """What ``planner`` calculates, from parameters (B, np) to plans in the flat layout (B, flat_size).

    Turns of angles and scaling are part of it, in double precision whatever the precision of the parameters; the
    network calculates in that of its weights, which are copies of the planner's.
    """

    network: Module
    first: Tensor
    end: Tensor
    low: Tensor
    period: Tensor
    into_plan: Tensor
    input_mean: Tensor
    input_std: Tensor
    output_mean: Tensor
    output_std: Tensor

    _BUFFERS = ("first", "end", "low", "period", "into_plan", "input_mean", "input_std", "output_mean", "output_std")

    def __init__(self, planner: NetworkPlanner) -> None:
        super().__init__()
        self.network, self.mixing = module_of(planner.network), planner.mixing
        arrays = PlannerArrays.of(planner)
        self.periodic = bool(arrays.periodic.any())
        for name in self._BUFFERS:
            value = getattr(arrays, name)
            self.register_buffer(name, torch.tensor(value, dtype=torch.float64))

    def forward(self, p: Tensor) -> Tensor:
        """Plans (B, flat_size) in double precision of parameters ``p`` (B, np), which are not checked."""
        p = p.double()
        within = self._in_one_turn(p) if self.periodic else p
        x = (within - self.input_mean) / self.input_std
        z = self._predicted(x.to(next(self.network.parameters()).dtype)).double()
        z = z * self.output_std + self.output_mean
        return z + (p - within) @ self.into_plan if self.periodic else z

    def _predicted(self, x: Tensor) -> Tensor:
        if isinstance(self.network, MixtureModule):
            return self.network.from_all_experts(x, self.mixing)
        return self.network(x)

    def _in_one_turn(self, p: Tensor) -> Tensor:
        """As :meth:`ocp_envs.parameters.Parametrisation.in_one_turn` does."""
        turned = self.low + torch.remainder(p - self.low, self.period)
        turned = torch.where(turned >= self.end, turned - self.period, turned)
        return torch.where((p >= self.first) & (p < self.end), p, turned)
