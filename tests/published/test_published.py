"""Problems of the literature end at their published optima, each within 0.1 %.

Each module of this folder declares one of them, in at most 60 lines.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from ocp_envs import Status
from ocp_envs.solvers.optimum import Multistart, solved_from
from tests.in_process import Solver

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]
FILES = {path.stem: path for path in Path(__file__).parent.glob("*.py")}
NAMES = sorted(name for name in FILES if name != "case" and not name.startswith("test_"))
#: Those of control-toolbox/OptimalControlProblems.jl when it had twenty.
COLLECTION = {
    "beam", "bioreactor", "cart_pendulum", "chain", "dielectrophoretic_particle", "double_oscillator", "ducted_fan",
    "electric_vehicle", "glider", "insurance", "jackson", "moonlander", "quadrotor", "robbins", "robot", "rocket",
    "space_shuttle", "steering", "truck_trailer", "vanderpol",
}  # fmt: skip


def case_of(name):
    return importlib.import_module(f"tests.published.{name}").CASE


@pytest.mark.parametrize("name", NAMES)
def test_the_optimum_is_the_published_one(name):
    case = case_of(name)
    solution = solved_from(Solver(case.problem), np.array([case.p]), [], Multistart(case.starts, 0))
    assert solution.status == Status.SOLVED, solution.reason
    assert solution.cost == pytest.approx(case.optimum, rel=case.rel)


@pytest.mark.parametrize("name", NAMES)
def test_each_is_declared_in_at_most_60_lines(name):
    assert len(FILES[name].read_text(encoding="utf-8").splitlines()) <= 60


def test_most_of_the_collection_can_be_declared():
    assert len(COLLECTION & set(NAMES)) >= 15
