import threading
import warnings

import pytest

from ocp_envs.data import generation, worker
from ocp_envs.data.generation import generate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from ocp_envs.support.compiler import CompiledNotAvailable
from tests.data.running import COUNT, SMALL, Unguarded


@pytest.fixture(scope="module", autouse=True)
def _interpreted():
    """Children inherit the environment: without a compiler they start at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", "")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CompiledNotAvailable)
            yield


@pytest.fixture
def unguarded(monkeypatch):
    for module in (worker, generation):
        monkeypatch.setattr(module, "GuardedSolver", Unguarded)
    monkeypatch.setattr(worker, "KEPT", threading.local())
    Unguarded.asked.clear()
    return Unguarded


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The database that was never interrupted, by the default pool."""
    path = tmp_path_factory.mktemp("whole") / "d.zarr"
    return generate(PENDULUM, path, sample(PENDULUM, 7, COUNT), workers=2, seed=3, settings=SMALL)
