"""Exported graphs of network planners are right for every p and every batch size."""

from __future__ import annotations

import dataclasses
import io
import warnings

import numpy as np
import pytest
import torch

import moe_policy
from moe_policy.planners.modules import module_of
from moe_policy.planners.networks import ARGMAX, Softmax
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER

PLANNERS = {
    "single network": moe_policy.load(PENDULUM, "snn"),
    "argmax": moe_policy.load(PENDULUM, "moe-custom"),
    "softmax": moe_policy.load(PENDULUM, "moe-retrained-softmax-0.1"),
    "without angles": moe_policy.load(QUADCOPTER, "moe-kmeans-4"),
}
#: The batch with which a graph is recorded; others are evaluated.
RECORDED, BATCHES = 3, (1, 3, 200)
every_planner = pytest.mark.parametrize("kind", PLANNERS)


def parameters(planner, count):
    """Instances in the box, every other one of which is written in another turn, if there are angles."""
    problem = planner.problem
    p = problem.parameters.draw(np.random.default_rng(0), count)
    angles = problem.parametrisation.turn[0]
    return p + 2 * angles * (np.arange(count) % 2)[:, None]


def check(planner, graph):
    for count in BATCHES:
        p = parameters(planner, count)
        with torch.no_grad():
            z = np.asarray(graph(torch.from_numpy(p)))
        plans = planner(p).flat()
        np.testing.assert_allclose(z, plans, rtol=1e-6, atol=1e-6 * np.abs(plans).max())


@every_planner
def test_the_module_is_the_planner(kind):
    check(PLANNERS[kind], PLANNERS[kind].module())


@pytest.mark.parametrize("strict", [False, True])
@every_planner
def test_an_exported_program_is_the_planner_for_every_batch(kind, strict):
    planner = PLANNERS[kind]
    example, batch = torch.from_numpy(parameters(planner, RECORDED)), ({0: torch.export.Dim("batch")},)
    check(planner, torch.export.export(planner.module(), (example,), dynamic_shapes=batch, strict=strict).module())


@every_planner
def test_a_traced_module_is_the_planner_for_every_batch(kind):
    planner = PLANNERS[kind]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("error", torch.jit.TracerWarning)
        traced = torch.jit.trace(planner.module(), torch.from_numpy(parameters(planner, RECORDED)))
    check(planner, traced)


@pytest.mark.parametrize("mixing", [ARGMAX, Softmax(0.5)])
def test_the_network_alone_can_be_exported_and_traced(mixing):
    network, x = module_of(PLANNERS["argmax"].network), torch.randn(60, 2, generator=torch.Generator().manual_seed(0))

    class Mixed(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.network = network

        def forward(self, x):
            return self.network(x, mixing)

    exported = torch.export.export(Mixed(), (x[:3],), dynamic_shapes=({0: torch.export.Dim("batch")},)).module()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        traced = torch.jit.trace(Mixed(), x[:3])
    for graph in (exported, traced):
        torch.testing.assert_close(graph(x), network(x, mixing), rtol=1e-5, atol=1e-5)


@pytest.mark.slow
@every_planner
def test_onnx_files_are_the_planner_for_every_batch(kind):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnxscript")
    planner, file = PLANNERS[kind], io.BytesIO()
    example, batch = torch.from_numpy(parameters(planner, RECORDED)), ({0: torch.export.Dim("batch")},)
    torch.onnx.export(planner.module(), (example,), dynamic_shapes=batch, dynamo=True).save(file)
    session = runtime.InferenceSession(file.getvalue())
    (name,) = (given.name for given in session.get_inputs())
    check(planner, lambda p: session.run(None, {name: p.numpy()})[0])


def test_the_module_has_the_weights_of_the_planner():
    planner = PLANNERS["argmax"]
    found = planner.module().network.network().tensors()
    assert found.keys() == planner.network.tensors().keys()
    for name, values in planner.network.tensors().items():
        np.testing.assert_array_equal(found[name], values)
    assert dataclasses.replace(planner, mixing=Softmax(0.5)).module().mixing == Softmax(0.5)
