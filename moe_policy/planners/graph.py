"""A network planner as one PyTorch module, whose graph can be exported."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

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
    inputs_mean: Tensor
    inputs_std: Tensor
    outputs_mean: Tensor
    outputs_std: Tensor

    def __init__(self, planner: NetworkPlanner) -> None:
        super().__init__()
        self.network, self.mixing = module_of(planner.network), planner.mixing
        problem, (periods, first, end) = planner.problem, planner.problem.parametrisation.turn
        in_state, slots, _ = problem.parametrisation.slots
        knots = np.arange(problem.knots)[:, None] * problem.system.nx
        into_plan = np.zeros((len(problem.parameters), problem.flat_size))
        for component, slot in zip(in_state, slots):
            into_plan[component, knots + slot] = 1.0
        self.periodic = bool(periods.any())
        for name, value in {
            "first": first,
            "end": end,
            "low": problem.parameters.centre - periods / 2,
            "period": np.where(periods > 0, periods, 1.0),
            "into_plan": into_plan,
            "inputs_mean": planner.inputs.mean,
            "inputs_std": planner.inputs.std,
            "outputs_mean": planner.outputs.mean,
            "outputs_std": planner.outputs.std,
        }.items():
            self.register_buffer(name, torch.tensor(value, dtype=torch.float64))

    def forward(self, p: Tensor) -> Tensor:
        """Plans (B, flat_size) in double precision of parameters ``p`` (B, np), which are not checked."""
        p = p.double()
        within = self._in_one_turn(p) if self.periodic else p
        x = (within - self.inputs_mean) / self.inputs_std
        z = self._predicted(x.to(next(self.network.parameters()).dtype)).double()
        z = z * self.outputs_std + self.outputs_mean
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
