"""A network planner as an ONNX graph, from p to the plan and the expert that made it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from moe_policy.planners.arrays import PlannerArrays
from moe_policy.planners.networks import NEGATIVE_SLOPE, MixtureOfExperts, SingleNetwork, Softmax
from ocp_envs.support.files import replacing

if TYPE_CHECKING:
    from moe_policy.planners.network import NetworkPlanner

#: Version of ONNX's operators: old enough for any runtime of the last years.
OPSET = 17


class _Graph:
    """Nodes and constants of a graph under construction; values are known by name."""

    def __init__(self, onnx: Any) -> None:
        self.onnx, self.nodes, self.constants = onnx, list[Any](), list[Any]()

    def constant(self, value: object) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.asarray(value), name))
        return name

    def node(self, kind: str, *inputs: str, output: str | None = None, **attributes: object) -> str:
        """The name of the result of an operator."""
        name = output or f"value_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def cast(self, value: str, kind: str) -> str:
        return self.node("Cast", value, to=getattr(self.onnx.TensorProto, kind))

    def layers(self, network: SingleNetwork, x: str) -> str:
        last = len(network.weights) - 1
        for i, (weight, bias) in enumerate(zip(network.weights, network.biases)):
            x = self.node("Gemm", x, self.constant(weight), self.constant(bias), transB=1)
            if i < last:
                x = self.node("LeakyRelu", x, alpha=NEGATIVE_SLOPE)
        return x

    def in_one_turn(self, arrays: PlannerArrays, p: str) -> str:
        """``p`` with its angles in one turn, see :class:`~moe_policy.planners.arrays.PlannerArrays`."""
        low, period, end = (self.constant(each) for each in (arrays.low, arrays.period, arrays.end))
        from_low = self.node("Sub", p, low)
        turns = self.node("Floor", self.node("Div", from_low, period))
        turned = self.node("Add", low, self.node("Sub", from_low, self.node("Mul", turns, period)))
        late = self.node("Not", self.node("Less", turned, end))
        turned = self.node("Where", late, self.node("Sub", turned, period), turned)
        early = self.node("Less", p, self.constant(arrays.first))
        here = self.node("And", self.node("Not", early), self.node("Less", p, end))
        keep = self.node("Or", here, self.constant(~arrays.periodic))
        return self.node("Where", keep, p, turned)

    def mixed(self, planner: NetworkPlanner, mixture: MixtureOfExperts, x: str) -> tuple[str, str]:
        """The output of a ``mixture`` at ``x``, and the expert with the largest logit."""
        logits = self.layers(mixture.gate, x)
        chosen = self.node("ArgMax", logits, axis=1, keepdims=0)
        if isinstance(planner.mixing, Softmax):
            sharp = self.node("Div", self.cast(logits, "DOUBLE"), self.constant(planner.mixing.epsilon))
            weights = self.cast(self.node("Softmax", sharp, axis=1), "FLOAT")
        else:
            depth, values = self.constant(len(mixture.experts)), self.constant(np.array([0.0, 1.0], np.float32))
            weights = self.node("OneHot", chosen, depth, values, axis=1)
        total = ""
        for i, expert in enumerate(mixture.experts):
            weight = self.node("Gather", weights, self.constant(np.array([i])), axis=1)
            part = self.node("Mul", weight, self.layers(expert, x))
            total = self.node("Add", total, part) if total else part
        return total, chosen


def write_onnx(planner: NetworkPlanner, path: str | os.PathLike[str]) -> None:
    """Write ``planner`` to ``path`` as :meth:`NetworkPlanner.to_onnx` describes."""
    try:
        import onnx
    except ImportError as error:
        raise ImportError("to_onnx needs the package onnx; pip install 'ocp-moe[onnx]'") from error
    arrays, graph = PlannerArrays.of(planner), _Graph(onnx)
    within = graph.in_one_turn(arrays, "p")
    centred = graph.node("Sub", within, graph.constant(arrays.input_mean))
    x = graph.cast(graph.node("Div", centred, graph.constant(arrays.input_std)), "FLOAT")
    if isinstance(planner.network, MixtureOfExperts):
        y, chosen = graph.mixed(planner, planner.network, x)
    else:
        y = graph.layers(planner.network, x)
        first = graph.node("Gather", x, graph.constant(np.array(0)), axis=1)
        chosen = graph.cast(graph.node("Mul", first, graph.constant(np.float32(0))), "INT64")
    z = graph.node("Mul", graph.cast(y, "DOUBLE"), graph.constant(arrays.output_std))
    z = graph.node("Add", z, graph.constant(arrays.output_mean))
    turns = graph.node("MatMul", graph.node("Sub", "p", within), graph.constant(arrays.into_plan))
    graph.node("Add", z, turns, output="plan")
    graph.node("Identity", chosen, output="expert")
    model = _model(onnx, graph, planner)
    onnx.checker.check_model(model, full_check=True)
    with replacing(path) as file:
        file.write(model.SerializeToString())


def _model(onnx: Any, graph: _Graph, planner: NetworkPlanner) -> Any:
    def value(name: str, kind: str, shape: Sequence[object]) -> Any:
        return onnx.helper.make_tensor_value_info(name, getattr(onnx.TensorProto, kind), list(shape))

    problem = planner.problem
    inputs = [value("p", "DOUBLE", ("batch", len(problem.parameters)))]
    outputs = [value("plan", "DOUBLE", ("batch", problem.flat_size)), value("expert", "INT64", ("batch",))]
    made = onnx.helper.make_graph(graph.nodes, planner.name, inputs, outputs, graph.constants)
    opset = [onnx.helper.make_opsetid("", OPSET)]
    model = onnx.helper.make_model(made, opset_imports=opset, producer_name="ocp-moe", ir_version=8)
    facts = {
        "problem": problem.id,
        "fingerprint": problem.fingerprint,
        "p": " ".join(problem.parameters.names),
        "layout": f"plan = [x_0 … x_{problem.knots - 1}, u_0 … u_{problem.knots - 2}, t_f]",
    }
    onnx.helper.set_model_props(model, facts)
    return model
