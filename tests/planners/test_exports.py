"""Planners as ONNX graphs and as CasADi functions are the planners."""

from __future__ import annotations

import sys

import casadi as ca
import numpy as np
import pytest

import moe_policy
from tests.planners.test_graph import BATCHES, PLANNERS, every_planner, parameters


@every_planner
def test_an_onnx_graph_is_the_planner_for_every_batch(kind, tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    planner = PLANNERS[kind]
    planner.to_onnx(tmp_path / "planner.onnx")
    session = runtime.InferenceSession(str(tmp_path / "planner.onnx"), providers=["CPUExecutionProvider"])
    for count in BATCHES:
        p = parameters(planner, count)
        plan, expert = session.run(["plan", "expert"], {"p": p})
        wanted = planner(p).flat()
        np.testing.assert_allclose(plan, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
        mixture = isinstance(planner.network, moe_policy.MixtureOfExperts)
        np.testing.assert_array_equal(expert, planner.gate(p)[0] if mixture else np.zeros(count))
    facts = session.get_modelmeta().custom_metadata_map
    assert facts["problem"] == planner.problem.id
    assert facts["fingerprint"] == planner.problem.fingerprint


@every_planner
def test_a_casadi_function_is_the_planner(kind):
    planner = PLANNERS[kind]
    function, p = planner.to_casadi(), parameters(planner, 50)
    plan, expert = (np.array(each).T for each in function.map(50)(p.T))
    wanted = planner(p).flat()
    np.testing.assert_allclose(plan, wanted, rtol=1e-5, atol=1e-5 * np.abs(wanted).max())
    if isinstance(planner.network, moe_policy.MixtureOfExperts):
        np.testing.assert_array_equal(expert[:, 0], planner.gate(p)[0])


def test_a_casadi_function_can_be_differentiated():
    function = PLANNERS["argmax"].to_casadi()
    p = ca.MX.sym("p", 2)
    jacobian = ca.Function("jacobian", [p], [ca.jacobian(function(p)[0], p)])
    at, step = np.array([0.4, 0.3]), 1e-5
    ahead, behind = (np.array(function(at + d * np.array([1, 0]))[0]) for d in (step, -step))
    np.testing.assert_allclose(np.array(jacobian(at))[:, 0], (ahead - behind)[:, 0] / (2 * step), atol=1e-4)


def test_without_the_package_onnx_the_cure_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match=r"pip install 'ocp-moe\[onnx\]'"):
        PLANNERS["argmax"].to_onnx(tmp_path / "planner.onnx")
    assert not any(tmp_path.iterdir())
