"""Environments of other packages: how they are measured, also in another process, and what cannot be measured."""

import sys

import numpy as np
import pytest

from moe_policy.experiments.speed import peers
from moe_policy.experiments.speed.peers import Contender, compared, crazyflow, ours
from ocp_envs.problems.pendulum import PENDULUM

ANSWERS = """
import sys
print("9.9", flush=True)
for line in sys.stdin:
    print(2e6 * float(line), 3e6, flush=True)
"""


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Takes the place of the program that measures crazyflow."""
    path = tmp_path / "program.py"
    monkeypatch.setattr(peers, "_CRAZYFLOW", path)
    return path.write_text


def test_the_first_of_a_group_is_what_the_others_are_compared_with():
    rates = iter([[1.0, 99.0], [10.0, 5.0], [20.0, 4.0], [30.0, 3.0]])  # the first round warms up
    both = [Contender(name="a", step="", dt=0.1), Contender(name="b", step="", dt=0.5)]
    one, other = compared([(both, lambda seconds: next(rates))], 8, 3, 1.0)
    assert (one.steps_per_second, one.ratio, other.steps_per_second, other.ratio) == (20.0, 1.0, 4.0, 5.0)
    assert (one.simulated_seconds_per_second, other.simulated_seconds_per_second) == (2.0, 2.0)


def test_our_steps_are_counted():
    contender, measure = ours(PENDULUM, 4)
    assert "control step with 1 Runge-Kutta steps" in contender.step
    assert np.isfinite(measure(0.01)).all()
    assert measure(0.01)[0] > 0


def test_another_process_measures_when_it_is_asked(program):
    program(ANSWERS)
    with crazyflow(sys.executable, 16) as (contenders, measure):
        assert [contender.name for contender in contenders] == [
            "crazyflow 9.9, DroneReachPos-v0",
            "crazyflow 9.9, Sim.step",
        ]
        assert measure(0.5) == [1e6, 3e6]
        assert measure(1.0) == [2e6, 3e6]


def test_a_process_that_does_not_run_says_why(program):
    program("raise ImportError('no crazyflow here')")
    with pytest.raises(RuntimeError, match="ImportError: no crazyflow here"), crazyflow(sys.executable, 16):
        pass
