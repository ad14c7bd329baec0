"""A network planner as a CasADi function, for those who put it into an optimiser of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from moe_policy.planners.arrays import PlannerArrays
from moe_policy.planners.networks import NEGATIVE_SLOPE, MixtureOfExperts, SingleNetwork, Softmax

if TYPE_CHECKING:
    from moe_policy.planners.network import NetworkPlanner


def casadi_function(planner: NetworkPlanner) -> ca.Function:
    """``planner`` as :meth:`NetworkPlanner.to_casadi` describes."""
    arrays, p = PlannerArrays.of(planner), ca.MX.sym("p", len(planner.problem.parameters))
    within = _in_one_turn(arrays, p)
    x = (within - ca.DM(arrays.input_mean)) / ca.DM(arrays.input_std)
    y, chosen = _predicted(planner, x)
    z = y * ca.DM(arrays.output_std) + ca.DM(arrays.output_mean) + ca.mtimes(ca.DM(arrays.into_plan.T), p - within)
    return ca.Function("planner", [p], [z, chosen], ["p"], ["plan", "expert"])


def _in_one_turn(arrays: PlannerArrays, p: ca.MX) -> ca.MX:
    within = []
    for i, component in enumerate(ca.vertsplit(p)):
        if not arrays.periodic[i]:
            within.append(component)
            continue
        low, period, first, end = (float(each[i]) for each in (arrays.low, arrays.period, arrays.first, arrays.end))
        turned = component - period * ca.floor((component - low) / period)
        turned = ca.if_else(turned >= end, turned - period, turned)
        within.append(ca.if_else(ca.logic_and(component >= first, component < end), component, turned))
    return ca.vertcat(*within)


def _layers(network: SingleNetwork, x: ca.MX) -> ca.MX:
    last = len(network.weights) - 1
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases)):
        x = ca.mtimes(ca.DM(weight.astype(float)), x) + ca.DM(bias.astype(float))
        if i < last:
            x = ca.fmax(x, NEGATIVE_SLOPE * x)
    return x


def _predicted(planner: NetworkPlanner, x: ca.MX) -> tuple[ca.MX, ca.MX]:
    """The network's output at ``x``, and the expert with the largest logit."""
    network = planner.network
    if not isinstance(network, MixtureOfExperts):
        return _layers(network, x), ca.MX(0)
    logits = _layers(network.gate, x)
    largest, chosen = ca.mmax(logits), ca.MX(len(network.experts) - 1)
    for i in reversed(range(len(network.experts) - 1)):
        chosen = ca.if_else(logits[i] >= largest, i, chosen)
    if isinstance(planner.mixing, Softmax):
        weights = ca.exp((logits - largest) / planner.mixing.epsilon)
        shares = ca.vertsplit(weights / ca.sum1(weights))
    else:
        shares = [chosen == i for i in range(len(network.experts))]
    total = ca.MX(0)
    for share, expert in zip(shares, network.experts):
        total = total + share * _layers(expert, x)
    return total, chosen
