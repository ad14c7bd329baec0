"""Tracking policies as C: one file and its header, without allocation, for a controller that has no Python.

The file holds the weights of the network, the plan's resampling, the regulators (``follow.c``) and the control step
(``step.c``). Weights are in single precision; everything is calculated in double precision, also the network, which
Python calculates in single precision: plans differ by its rounding.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.following import numbers_of
from moe_policy.control.lqr import Regulator
from moe_policy.control.program import TRACKING
from moe_policy.control.step import box_arrays
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import NEGATIVE_SLOPE, MixtureOfExperts, SingleNetwork, Softmax
from ocp_envs.parameters import SEAM
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.clock import count_steps
from ocp_envs.support.files import replacing
from ocp_envs.support.programs import text, written
from ocp_envs.system import Box

if TYPE_CHECKING:
    from moe_policy.control.tracking import TrackingPolicy

_HEADER, _PROGRAM = (Path(__file__).with_name(f"export.{kind}") for kind in "hc")


def write(policy: TrackingPolicy, folder: Path, name: str) -> Path:
    """Write ``policy`` as ``<name>.c`` and ``<name>.h`` into ``folder``; the path of the C.

    Names of C begin with ``name``.

    Raises:
        TypeError: the policy's planner is no network.
        ValueError: a name that is no identifier of C, or a goal that is not one state for all instances.
    """
    planner, problem = policy.planner, policy.problem
    if not isinstance(planner, NetworkPlanner):
        raise TypeError(f"to_c: expected a policy whose planner is a NetworkPlanner, got {planner!r}")
    if policy.regulator.varies or not (problem.terminal.plain and problem.horizon.numeric):
        raise ValueError(
            f"to_c: {problem.id} has a goal, a duration or gains at the goal that depend on the context, or a goal "
            "that is no single state; only policies to one goal state can be written as C"
        )
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise ValueError(f"name: expected a name of C, of letters, digits and underscores, got {name!r}")
    functions = [
        _renamed(function, f"{name}_{function.name()}")
        for function in (
            problem.functions.rate().function,
            problem.functions.linearisation(policy.regulator.substeps).jacobian.function,
        )
    ]
    sizes = _sizes(problem, policy.dt)
    macros = {**sizes, **_numbers(planner)}
    macros |= {f"{f.name().removeprefix(f'{name}_').upper()}_W": f.sz_w() for f in functions}
    parts = [
        f'/* See {name}.h. */\n\n#include "{name}.h"\n#define API(part) {name}_##part\n#define LOCAL static',
        written(functions, f"{name}_casadi"),
        *(f"#define {f.name().removeprefix(f'{name}_')} {f.name()}" for f in functions),
        *_arrays(planner, policy.regulator),
        *_networks(planner),
        text([*TRACKING, _PROGRAM], [], macros),
    ]
    for kind, content in (("h", _header(policy, name, sizes)), ("c", "\n".join(parts))):
        with replacing(folder / f"{name}.{kind}") as file:
            file.write(content.encode())
    return folder / f"{name}.c"


def _renamed(function: ca.Function, name: str) -> ca.Function:
    inputs = function.sx_in()
    return ca.Function(name, inputs, function.call(inputs))


def _sizes(problem: OptimalControlProblem, dt: float) -> dict[str, int]:
    """Sizes of a policy's arrays, by macro."""
    system = problem.system
    return {
        "NP": len(problem.parameters),
        "NX": system.nx,
        "NU": system.nu,
        "NC": len(problem.context),
        "KNOTS": problem.knots,
        "PLAN": problem.flat_size,
        "LENGTH": int(count_steps(problem.horizon.longest, dt)) + 1,
    }


def _numbers(planner: NetworkPlanner) -> dict[str, float | int]:
    """The other numbers of a policy, by macro."""
    network = planner.network
    parts = [network.gate, *network.experts] if isinstance(network, MixtureOfExperts) else [network]
    return {
        "SEAM": SEAM,
        "NEGATIVE_SLOPE": NEGATIVE_SLOPE,
        "EXPERTS": len(parts) - 1 or 1,
        "EPSILON": planner.mixing.epsilon if isinstance(planner.mixing, Softmax) else 0.0,
        "WIDEST": max(max(part.sizes) for part in parts),
    }


def _arrays(planner: NetworkPlanner, regulator: Regulator) -> Iterator[str]:
    """The constant arrays of a policy, but for the networks."""
    problem, weights = planner.problem, regulator.weights
    parametrisation, state = problem.parametrisation, problem.system.state
    (periods, first, end), (in_state, slots, in_context) = parametrisation.turn, parametrisation.slots
    slot = np.full(len(problem.parameters), -1)
    slot[in_state] = slots
    values: Mapping[str, ArrayLike] = {
        "turn": periods,
        "turn_low": problem.parameters.centre - periods / 2,
        "turn_first": np.where(periods > 0, first, 0.0),
        "turn_end": np.where(periods > 0, end, 0.0),
        "input_mean": planner.inputs.mean,
        "input_std": planner.inputs.std,
        "output_mean": planner.outputs.mean,
        "output_std": planner.outputs.std,
        "state_lower": state.lower,
        "state_upper": state.upper,
        **dict(zip(("period", "control_lower", "control_upper"), box_arrays(problem))),
        "goal_state": problem.terminal.central_state,
        "goal_control": problem.terminal.central_control,
        "durations": problem.horizon.of(problem.context.centre[None]),
        "numbers": numbers_of(regulator),
        "weight_state": weights.state,
        "weight_control": weights.control,
        "weight_terminal": regulator.central.terminal,
        "hold_gain": regulator.central.gain,
        "hold_norm": regulator.central.norm,
    }
    yield from (_array("double", name, value) for name, value in values.items())
    yield _array("int", "slot", slot)
    yield _array("int", "context_slot", in_context)


def _networks(planner: NetworkPlanner) -> Iterator[str]:
    """The types and the weights of the networks; those of a layer are stored input by input."""
    network = planner.network
    yield "typedef struct { int inputs, outputs; const float *weights, *biases; } layer;"
    yield "typedef struct { int layers; const layer *layer; } network;"
    if isinstance(network, MixtureOfExperts):
        yield from _layers("gate", network.gate)
        yield f"static const network gate = {{{len(network.gate.weights)}, gate_layers}};"
        experts: Sequence[SingleNetwork] = network.experts
    else:
        yield "static const network gate = {0, 0};"
        experts = [network]
    for i, expert in enumerate(experts):
        yield from _layers(f"expert_{i}", expert)
    rows = ", ".join(f"{{{len(expert.weights)}, expert_{i}_layers}}" for i, expert in enumerate(experts))
    yield f"static const network experts[] = {{{rows}}};"


def _layers(name: str, network: SingleNetwork) -> Iterator[str]:
    """The layers of one ``network``."""
    for i, (weight, bias) in enumerate(zip(network.weights, network.biases)):
        yield _array("float", f"{name}_weights_{i}", weight.T)
        yield _array("float", f"{name}_biases_{i}", bias)
    rows = ", ".join(
        f"{{{weight.shape[1]}, {weight.shape[0]}, {name}_weights_{i}, {name}_biases_{i}}}"
        for i, weight in enumerate(network.weights)
    )
    yield f"static const layer {name}_layers[] = {{{rows}}};"


def _array(kind: str, name: str, values: ArrayLike) -> str:
    """The constant array ``name`` of numbers of a ``kind``, each exact; an empty one has a zero."""
    ending = "f" if kind == "float" else ""
    numbers = [f"{value}{ending}" for value in np.ravel(values)] or ["0"]  # the shortest decimals that are exact
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return f"static const {kind} {name}[] = {{\n" + ",\n".join(lines) + "};"


def _header(policy: TrackingPolicy, name: str, sizes: Mapping[str, int]) -> str:
    """The header of a ``policy`` with arrays of ``sizes``."""
    problem = policy.problem
    values = {
        **sizes,
        "title": repr(policy).replace("*/", ""),
        "name": name,
        "NAME": name.upper(),
        "INTERVALS": problem.knots - 1,
        "OBSERVATIONS": problem.system.nx + len(problem.context),
        "DT": policy.dt,
        "parameters": _named(problem.parameters),
        "observation": _named(problem.system.state, problem.context),
        "control": _named(problem.system.control),
    }
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), _HEADER.read_text())


def _named(*boxes: Box) -> str:
    """The coordinates of ``boxes`` with their units."""
    return ", ".join(f"{c.name} [{c.unit}]" for box in boxes for c in box.coordinates)
