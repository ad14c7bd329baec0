"""Speed of the environments, and how speed and accuracy depend on the number of Runge-Kutta steps in a control step."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from moe_policy.experiments.records import Record, renamed
from ocp_envs.envs.simulation import Simulator
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.accuracy import integrate
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import Provenance
from ocp_envs.system import Box

#: Control period, seconds.
DT = 0.02
SUBSTEPS = (1, 2, 3, 4)
#: Random states on which the error is measured: seed, number, and by name the part of all boxes they are drawn from.
SEED, SAMPLES, REGIONS = 707, 5_000, {"whole": 1.0, "middle": 2 / 3}


@dataclass(frozen=True, kw_only=True)
class StepError(Record):
    """Norm of the error of the state after one control step, in state units."""

    median: float
    percent_99: float = renamed("99_percent")
    largest: float


@dataclass(frozen=True, kw_only=True)
class Substeps(Record):
    """Rate, and error by region, with a number of Runge-Kutta steps in a control step; the environment's is chosen."""

    substeps: int
    chosen: bool
    steps_per_second: float
    error: dict[str, StepError]

    def text(self) -> str:
        """Rate and error in one line."""
        whole = self.error["whole"]
        return (
            f"{self.substeps} Runge-Kutta steps{' (chosen)' if self.chosen else ''}: "
            f"{self.steps_per_second:,.0f} control steps/s, error {whole.median:.1e} (median), "
            f"{whole.percent_99:.1e} (99 %), {whole.largest:.1e} (maximum)"
        )


@dataclass(frozen=True, kw_only=True)
class SingleStep(Record):
    """Microseconds of a control step, resets included, of the pendulum here and of Gymnasium's, and their ratio."""

    ours: float = renamed("PendulumSwingup-v0")
    theirs: float = renamed("Pendulum-v1")
    ratio: float


@dataclass(frozen=True, kw_only=True)
class EnvironmentSpeed(Record):
    """Speed on one core: by id of the problem, single steps with and without the wrappers of ``gym.make``."""

    num_envs: int
    steps_per_second: dict[str, float]
    single_step_microseconds: dict[str, SingleStep]
    substeps: dict[str, tuple[Substeps, ...]]
    provenance: Provenance


def best_time(run: Callable[[], None], repetitions: int) -> float:
    """Minimum duration of ``repetitions`` calls of ``run``, seconds."""
    durations = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        run()
        durations.append(time.perf_counter() - begin)
    return min(durations)


def vector_rate(envs: VectorEnv, steps: int, repetitions: int = 7) -> float:
    """Control steps per second, of all environments together; ``steps`` of them are timed at once."""
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = envs.action_space.sample()

    def run() -> None:
        for _ in range(steps):
            envs.step(actions)

    run()
    return envs.num_envs * steps / best_time(run, repetitions)


def single_step(env: gym.Env[object, object], steps: int = 5000, repetitions: int = 7) -> float:
    """Microseconds of a control step, resets included; ``steps`` of them are timed at once."""
    env.reset(seed=0)
    env.action_space.seed(0)
    action = env.action_space.sample()

    def run() -> None:
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    run()
    return best_time(run, repetitions) / steps * 1e6


def step_error(problem: OptimalControlProblem, substeps: int, fraction: float) -> StepError:
    """Error of a control step against SciPy's DOP853.

    States, controls and contexts are drawn from the middle ``fraction`` of their boxes.
    """
    rng = np.random.default_rng(SEED)

    def draw(box: Box) -> Array:
        return box.centre + fraction * box.width / 2 * rng.uniform(-1, 1, (SAMPLES, len(box)))

    x, u, s = (draw(box) for box in (problem.system.state, problem.system.control, problem.context))
    h = np.full(SAMPLES, DT)
    exact = integrate(problem.batch_rate(), x, u, s, h)
    error = np.linalg.norm(problem.batch_flow(substeps)(x, u, s, h[:, None])[0] - exact, axis=1)
    return StepError(
        median=float(np.median(error)), percent_99=float(np.quantile(error, 0.99)), largest=float(error.max())
    )


def substeps_of(problem: OptimalControlProblem, num_envs: int, repetitions: int = 7) -> tuple[Substeps, ...]:
    """Rate and accuracy of ``num_envs`` environments with one to four Runge-Kutta steps in a control step."""
    chosen = Simulator(problem, DT).substeps
    rows = []
    for substeps in SUBSTEPS:
        variant = dataclasses.replace(problem, longest_substep=DT / substeps)
        rate = vector_rate(VectorEnv(problem=variant, num_envs=num_envs), 20, repetitions)
        error = {region: step_error(problem, substeps, part) for region, part in REGIONS.items()}
        rows.append(Substeps(substeps=substeps, chosen=substeps == chosen, steps_per_second=rate, error=error))
    return tuple(rows)
