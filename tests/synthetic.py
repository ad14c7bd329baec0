"""Synthetic samples of the pendulum for tests of learning: smooth functions of p with a jump, no solver."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ocp_envs.data.beyond import Beyond
from ocp_envs.data.samples import Samples
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER_OBSTACLE
from ocp_envs.support.arrays import Ints
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class FakeDatabase:
    held: Samples

    def samples(self) -> Samples:
        return self.held


def fake_samples(count: int = 400, seed: int = 0, jump: float = 2 * np.pi, modes: int = 2) -> Samples:
    """Straight lines from the start to a goal that depends on the angle: mode i ends ``jump`` above mode i−1."""
    rng = np.random.default_rng(seed)
    box = PENDULUM.parameters
    p = box.draw(rng, count)
    mode = np.minimum((p[:, 0] / (2 * np.pi) * modes).astype(np.int64), modes - 1)
    progress = np.linspace(0, 1, PENDULUM.knots)[:, None]
    goal = np.stack([np.pi + jump * (mode - 1), np.zeros(count)], axis=1)
    states = p[:, None] * (1 - progress) + goal[:, None] * progress
    controls = np.cos(p[:, :1] + progress[:-1, 0])[..., None] * p[:, 1:, None] / 2
    return Samples.of(PENDULUM, p, Trajectory(states, controls, 3 + 0.2 * p[:, 1]), mode)


def beyond_borders(samples: Samples, families: Ints, rows: Ints) -> Beyond:
    """Trajectories of the next of the ``families`` (M,) at some ``rows`` of ``samples``, at little more cost."""
    rows, k = np.asarray(rows), int(families.max()) + 1
    other = (families[rows] + 1) % k
    cost = np.where(np.arange(k) == families[:, None], 1.0, np.inf)
    cost[rows, other] = 1.05
    return Beyond(np.ones(len(samples)), cost, rows, other, samples.trajectory[rows], 2 * len(rows))


def flights(count: int = 40, active: bool = True) -> Samples:
    """Straight flights past spheres, which push at one knot or, without contact, at none."""
    rng = np.random.default_rng(3)
    p = QUADCOPTER_OBSTACLE.parameters.draw(rng, count)
    progress = np.linspace(1, 0, QUADCOPTER_OBSTACLE.knots)[:, None]
    states = QUADCOPTER_OBSTACLE.start(p)[0][:, None] * progress
    controls = np.zeros((count, QUADCOPTER_OBSTACLE.knots - 1, QUADCOPTER_OBSTACLE.system.nu))
    samples = Samples.of(
        QUADCOPTER_OBSTACLE, p, Trajectory(states, controls, np.full(count, 3.0)), np.zeros(count, int)
    )
    multipliers = np.zeros((count, QUADCOPTER_OBSTACLE.knots, 1))
    multipliers[:, 7] = 2.0 if active else 0.0
    return replace(samples, multipliers=multipliers)
