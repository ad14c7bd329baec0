import dataclasses

import numpy as np
import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.solvers.nlp import Outcome, Status
from ocp_envs.solvers.transcription import transcribe
from tests.in_process import Solver
from tests.small_problems import DOUBLE_INTEGRATOR
from tests.solvers.programs import line

pytestmark = [
    pytest.mark.usefixtures("interpreted"),
    pytest.mark.filterwarnings("ignore::ocp_envs.support.compiler.CompiledNotAvailable"),
]


def test_a_stuck_primary_solver_gets_a_second_attempt_with_a_longer_duration(monkeypatch):
    solver, seen = Solver(DOUBLE_INTEGRATOR), []
    run = solver.runner.nlp.primary.run

    def stuck_at_first(task, lower, upper):
        seen.append(task)
        outcome, iterations = run(task, lower, upper)
        return (Outcome.STUCK if len(seen) == 1 else outcome), iterations

    monkeypatch.setattr(solver.runner.nlp.primary, "run", stuck_at_first)
    result = solver.solve(*line(DOUBLE_INTEGRATOR, [2.0, 0.0]), retry_with_fallback=False)
    assert result.solved[0]
    assert not result.fallback[0]
    second = transcribe(DOUBLE_INTEGRATOR).unpack(seen[1].guess[None], np.array([[2.0, 0.0]]))
    assert second.duration[0] == pytest.approx(0.75 * DOUBLE_INTEGRATOR.duration[1])


def test_what_the_primary_solver_breaks_down_on_goes_to_the_fallback(monkeypatch):
    solver = Solver(DOUBLE_INTEGRATOR)

    def broken(task, lower, upper):
        return Outcome.BROKE_DOWN, 3

    monkeypatch.setattr(solver.runner.nlp.primary, "run", broken)
    result = solver.solve(*line(DOUBLE_INTEGRATOR, [2.0, 0.0]), retry_with_fallback=False)
    assert result.solved[0]
    assert result.fallback[0]
    assert result.iterations[0] > 3


@pytest.mark.parametrize("retry", [True, False])
def test_the_fallback_retries_what_did_not_converge_only_where_asked(retry):
    hurried = dataclasses.replace(PENDULUM, duration=(0.1, 1.0))
    result = Solver(hurried).solve(*line(hurried, [0.0, 0.0], 1), retry_with_fallback=retry)
    assert result.status[0] == (Status.INFEASIBLE if retry else Status.NOT_CONVERGED)  # IPOPT can tell
    assert result.fallback[0] == retry
