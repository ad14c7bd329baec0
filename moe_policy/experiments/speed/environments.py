"""Speed of the environments, by Runge-Kutta steps in a control step, and of batched rollouts."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.protocols import Planner
from moe_policy.reports.records import ABSENT, Absent, Record, renamed
from moe_policy.rollouts.rollout import rollout
from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.envs.env import Env
from ocp_envs.envs.simulation import Simulator
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.accuracy import integrate
from ocp_envs.support.arrays import Array, Bools
from ocp_envs.support.batch import BatchFunction
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
class KernelSpeed(Record):
    """Rows per second of a function on many rows, of its compiled kernel and of CasADi's interpreter.

    Medians over interleaved runs; ``largest_difference`` is that of their results, relative to the largest result of
    each row or to 1.
    """

    function: str
    rows_per_second: float
    interpreted_rows_per_second: float
    ratio: float
    largest_difference: float


@dataclass(frozen=True, kw_only=True)
class EnvironmentSpeed(Record):
    """Speed on one core: by id of the problem, environments with observations and rewards, functions on as many rows,
    and single steps with and without the wrappers of ``gym.make``.
    """

    num_envs: int
    steps_per_second: dict[str, float]
    kernels: dict[str, tuple[KernelSpeed, ...]]
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


def kernels_of(problem: OptimalControlProblem, rows: int, repetitions: int) -> tuple[KernelSpeed, ...]:
    """Speed of the functions of ``problem`` on ``rows`` rows, from the middle half of their boxes."""
    rng = np.random.default_rng(SEED)
    x, u, s = (
        box.centre + box.width / 4 * rng.uniform(-1, 1, (rows, len(box)))
        for box in (problem.system.state, problem.system.control, problem.context)
    )
    h = np.full((rows, 1), DT)
    substeps = runge_kutta_steps(problem, DT, None)
    functions = {
        "control step": (BatchFunction(Simulator(problem, DT).step_function), (x, u, s)),
        "rate": (problem.functions.rate(), (x, u, s)),
        "linearisation": (problem.functions.linearisation(substeps).jacobian, (x, u, s, h)),
    }
    return tuple(_kernel_of(name, *each, repetitions) for name, each in functions.items())


def _kernel_of(name: str, compiled: BatchFunction, arguments: Sequence[Array], repetitions: int) -> KernelSpeed:
    """Speed of the function ``name`` at ``arguments``."""
    interpreted = BatchFunction(compiled.function, np.inf)
    found, wanted = compiled(*arguments), interpreted(*arguments)
    seconds: list[list[float]] = [[], []]
    for _ in range(repetitions):
        for function, times in zip((compiled, interpreted), seconds):
            began = time.perf_counter()
            function(*arguments)
            times.append(time.perf_counter() - began)
    fast, slow = (float(np.median(times)) for times in seconds)
    rows = len(arguments[0])
    return KernelSpeed(
        function=name,
        rows_per_second=rows / fast,
        interpreted_rows_per_second=rows / slow,
        ratio=slow / fast,
        largest_difference=max(_difference(*each) for each in zip(found, wanted, strict=True)),
    )


def _difference(found: Array, wanted: Array) -> float:
    """The largest difference, relative to the largest value of each row or to 1."""
    error, size = (np.abs(each).reshape(len(wanted), -1).max(axis=1, initial=0.0) for each in (found - wanted, wanted))
    return float((error / np.maximum(size, 1.0)).max())


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
    exact = integrate(problem.functions.rate(), x, u, s, h)
    error = np.linalg.norm(problem.functions.flow(substeps)(x, u, s, h[:, None])[0] - exact, axis=1)
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


@dataclass(frozen=True, kw_only=True)
class Batched(Record):
    """Seconds of batched rollouts: of all plans, of the gains along them, and of the whole."""

    planning: float
    tracking_setup: float
    whole: float


@dataclass(frozen=True, kw_only=True)
class RolloutSpeed(Record):
    """Batched rollouts of one planner against episodes one by one: medians over ``repeats`` interleaved runs.

    Episodes run in batches of as many as there are ``environments``. ``ratio``: time of an episode alone / its time in
    a batch. ``peak_memory_gb`` is that of the whole process.
    """

    env_id: str
    planner: str
    episodes: int
    dt: float
    seed: int
    repeats: int
    successes: int
    batched_seconds: Batched
    batched_seconds_per_episode: float
    single_episodes: int
    single_seconds_per_episode: float
    ratio: float
    same_successes: bool
    environments: int | Absent = ABSENT
    peak_memory_gb: float | Absent = ABSENT
    provenance: Provenance


def batched(problem: OptimalControlProblem, planner: Planner, p: Array, environments: int) -> tuple[Batched, Bools]:
    """Times of rollouts from ``p`` (B, np) in batches of as many as there are ``environments``, and successes (B,)."""
    policy, parts = TrackingPolicy(problem, planner, DT), range(0, len(p), environments)
    began = time.perf_counter()
    for first in parts:
        planner(p[first : first + environments])
    planned = time.perf_counter()
    for first in parts:
        policy.start(p[first : first + environments])
    started = time.perf_counter()
    envs = gym.make_vec(problem.id, num_envs=environments, dt=DT, terminate_at_goal=False, autoreset_mode="Disabled")
    whole = time.perf_counter()
    episodes = rollout(envs, policy, p)
    ended = time.perf_counter()
    planning = planned - began
    times = Batched(planning=planning, tracking_setup=started - planned - planning, whole=ended - whole)
    return times, episodes.success


def peak_memory_gb() -> float:
    """The largest memory that this process has had so far, GB."""
    import resource  # not on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9


def one_by_one(problem: OptimalControlProblem, planner: Planner, p: Array) -> tuple[float, Bools]:
    """Seconds of a loop over single environments from ``p`` (B, np), and its successes (B,)."""
    began = time.perf_counter()
    policy = TrackingPolicy(problem, planner, DT)
    env = Env(problem, dt=DT, terminate_at_goal=False)
    success = []
    for parameter in p:
        observation, _ = env.reset(options={"parameters": parameter})
        state = policy.start(parameter)
        for _ in range(round(float(policy.schedule(state).evaluation[0]) / DT)):
            action, state = policy.predict(observation, state)
            observation, _, terminated, _, info = env.step(action)
            if terminated:
                break
        success.append(info["is_success"] and not terminated)
    return time.perf_counter() - began, np.array(success)
