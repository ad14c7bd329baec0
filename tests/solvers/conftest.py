import pytest

from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.support import compiler
from tests.in_process import Solver


@pytest.fixture(scope="module")
def interpreted():
    """Compilation has its own tests; everything else goes without, and so in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiler, "find_compiler", lambda: None)
        yield


@pytest.fixture(scope="module")
def pendulum(interpreted):
    return Solver(PENDULUM)
