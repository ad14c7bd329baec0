"""What the page knows of a problem: its declaration, its planners, stored optima and the program, as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import moe_policy
from moe_policy.control.tracking import TrackingPolicy
from moe_policy.experiments.figures.style import looks
from moe_policy.experiments.page.packing import Packing
from moe_policy.experiments.page.program import longest, program
from moe_policy.experiments.page.rounding import rounded
from moe_policy.planners.arrays import PlannerArrays
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import NEGATIVE_SLOPE, MixtureOfExperts, SingleNetwork, Softmax
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.system import Box

Json = dict[str, Any]
#: Methods of the page by the names of shipped models; the colours are those that figures of comparisons give them.
_COLORS = {name: look["color"] for name, look in looks(["optimal", "nearest", "snn", "mixture"]).items()}


@dataclass(frozen=True)
class Shown:
    """A problem on the page.

    Args:
        env: id of the problem.
        mixture: name of the shipped mixture.
        stored: largest number of stored optima.
        rounded: whether weights have 8 bits: those of the sphere would take twice as much as all else.
    """

    env: str
    mixture: str
    stored: int
    rounded: bool = False

    @property
    def planners(self) -> dict[str, NetworkPlanner]:
        """The shipped planners by their names on the page, rounded as on the page."""
        names = {"snn": "snn", "mixture": self.mixture}
        found = {key: moe_policy.load(self.env, name, kind=NetworkPlanner) for key, name in names.items()}
        return {key: rounded(planner) if self.rounded else planner for key, planner in found.items()}


#: Problems that the page shows, by the names of their files.
SHOWN: Mapping[str, Shown] = {
    "pendulum": Shown("PendulumSwingup-v0", "moe-custom", 650),
    "vehicle": Shown("GroundVehicle-v0", "moe-custom", 400),
    "sphere": Shown("QuadcopterObstacle-v0", "moe-custom", 200, rounded=True),
}
#: Those of the committed page: the sphere's file would be a twelfth of the checkout.
USUAL = ("pendulum", "vehicle")


def contents(shown: Shown, sources: Path) -> Json:
    """All that the page needs for the problem ``shown``, with the C of the program in the folder ``sources``."""
    planners, packing = shown.planners, Packing(shown.rounded)
    policy = TrackingPolicy(planners["snn"].problem, planners["snn"])
    problem = policy.problem
    found: Json = {
        **_declaration(problem, policy.dt),
        "colors": {name: _COLORS[name] for name in ("snn", "mixture", "nearest")},
        "planners": {name: _network(planner, packing) for name, planner in planners.items()},
        "nearest": _stored(moe_policy.load(problem, "nearest", kind=NearestPlanner), shown.stored, packing),
        "program": packing.place(np.frombuffer(program(policy, sources), np.uint8), "uint8"),
    }
    return {**found, "block": packing.text()}


def _declaration(problem: OptimalControlProblem, dt: float) -> Json:
    _, slots, in_context = problem.parametrisation.slots
    start, context = problem.start(problem.parameters.centre[None])
    in_state = [i for i in range(len(problem.parameters)) if i not in in_context]
    return {
        "id": problem.id,
        "dt": dt,
        "knots": problem.knots,
        "parameters": _box(problem.parameters),
        "states": _box(problem.system.state),
        "controls": _box(problem.system.control),
        "start": start[0].tolist(),
        "inState": in_state,
        "slots": slots.tolist(),
        "inContext": in_context.tolist(),
        "goals": problem.terminal.bounds(context)[0][0].tolist(),
        "radius": problem.goal.radius,
        "hold": problem.hold,
        "longest": longest(problem, dt),
        "clearances": problem.n_clearances,
        "families": list(problem.modes.names),
    }


def _box(box: Box) -> Sequence[Json]:
    return [
        {"name": c.name, "unit": c.unit, "lower": c.lower, "upper": c.upper, "period": c.period}
        for c in box.coordinates
    ]


def _network(planner: NetworkPlanner, packing: Packing) -> Json:
    """The network of a ``planner`` and what it calculates around it (:class:`PlannerArrays`)."""
    network, arrays = planner.network, PlannerArrays.of(planner)
    gate, experts = (network.gate, network.experts) if isinstance(network, MixtureOfExperts) else (None, [network])
    turn = {name: np.where(arrays.periodic, getattr(arrays, name), 0.0) for name in ("first", "end", "low", "period")}
    return {
        "name": planner.name,
        "periodic": arrays.periodic.tolist(),
        **{name: values.tolist() for name, values in turn.items()},  # JSON has no infinite numbers
        "input_mean": arrays.input_mean.tolist(),
        "input_std": arrays.input_std.tolist(),
        "output_mean": packing.place(arrays.output_mean, "float64"),
        "output_std": packing.place(arrays.output_std, "float64"),
        "slope": NEGATIVE_SLOPE,
        "epsilon": planner.mixing.epsilon if isinstance(planner.mixing, Softmax) else 0,
        "gate": None if gate is None else _layers(gate, packing),
        "experts": [_layers(each, packing) for each in experts],
    }


def _layers(network: SingleNetwork, packing: Packing) -> Sequence[Json]:
    return [
        {"inputs": weight.shape[1], "weights": packing.weight(weight), "biases": packing.place(bias)}
        for weight, bias in zip(network.weights, network.biases)
    ]


def _stored(planner: NearestPlanner, count: int, packing: Packing) -> Json:
    """About ``count`` trajectories of a ``planner``, evenly among all, in half precision."""
    chosen = slice(None, None, -(-len(planner.parameters) // count))
    plans = planner.trajectory.flat()[chosen].astype(np.float16)
    return {
        "total": len(planner.parameters),
        "count": len(plans),
        "parameters": packing.place(planner.parameters[chosen], "float32"),
        "plans": packing.place(plans, "float32"),
        "families": packing.place(planner.mode[chosen], "uint8"),
    }
