import numpy as np

from ocp_envs.data.generation import generate
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.sets.sampling import sample
from tests.data.running import COUNT, SMALL, InProcess


def test_rounds_double_and_warm_starts_come_from_earlier_rounds_only(tmp_path, unguarded):
    """Spoilt trajectories of a round show up as guesses in later rounds alone."""
    executor = InProcess()
    database = generate(PENDULUM, tmp_path / "d", sample(PENDULUM, 7, COUNT), executor=executor, settings=SMALL)
    assert [task.number for task in executor.tasks] == list(range(8))
    assert [len(task.owner) > 0 for task in executor.tasks] == [False] * 2 + [True] * 6
    stored = database.stored(slice(0, COUNT)).z.astype(np.float32)
    for task in executor.tasks[2:]:
        before = 20 if task.number < 6 else 60  # rounds of 20, 40 and the rest
        known = stored[:before].reshape(-1, PENDULUM.flat_size)
        distance = np.abs(known[None] - task.z[:, None]).max(axis=2)
        assert np.nanmin(distance, axis=1).max() == 0
