"""Environments of other packages in the same run: steps per second, and seconds simulated in a second."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, Any, cast

import gymnasium as gym
import numpy as np

from moe_policy.reports.records import Record
from ocp_envs.control_step import runge_kutta_steps
from ocp_envs.envs.vector_env import VectorEnv
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.provenance import Provenance

#: Seconds → steps per second of each contender.
Measure = Callable[[float], Sequence[float]]
_CRAZYFLOW = Path(__file__).with_name("crazyflow_steps.py")


@dataclass(frozen=True, kw_only=True)
class Contender(Record):
    """An environment: what one step of it is, and how long it is."""

    name: str
    step: str
    dt: float


@dataclass(frozen=True, kw_only=True)
class PeerRow(Record):
    """Speed of one environment: medians over interleaved rounds; ``ratio``: rate of its group's first / its own."""

    name: str
    step: str
    environments: int
    steps_per_second: float
    simulated_seconds_per_second: float
    ratio: float


@dataclass(frozen=True, kw_only=True)
class Peers(Record):
    """Environments that are compared with each other, by group; those that could not be measured, and why."""

    groups: dict[str, tuple[PeerRow, ...]]
    missing: dict[str, str]
    provenance: Provenance


def stepped(env: Any, rows: int) -> Measure:
    """Steps of ``env`` with ``rows`` environments, resets of a single one included."""
    env.reset(seed=0)
    env.action_space.seed(0)
    action = env.action_space.sample()
    single = not isinstance(env, gym.vector.VectorEnv)

    def measure(seconds: float) -> list[float]:
        calls, began = 0, time.perf_counter()
        while (passed := time.perf_counter() - began) < seconds:
            for _ in range(20):
                _, _, terminated, truncated, _ = env.step(action)
                if single and (terminated or truncated):
                    env.reset()
            calls += 20
        return [calls * rows / passed]

    return measure


def ours(problem: OptimalControlProblem, rows: int, dt: float = 0.02) -> tuple[Contender, Measure]:
    """``rows`` environments of ``problem`` in a batch, with control steps of ``dt`` seconds."""
    substeps = runge_kutta_steps(problem, dt, None)
    text = f"control step with {substeps} Runge-Kutta steps in double precision, observation and reward"
    return Contender(name=problem.id, step=text, dt=dt), stepped(VectorEnv(problem, rows, dt=dt), rows)


@contextmanager
def crazyflow(python: str, rows: int) -> Iterator[tuple[Sequence[Contender], Measure]]:
    """crazyflow with ``rows`` drones, run by another ``python`` that has it.

    Raises:
        RuntimeError: it does not run; the message is the last line of its errors.
    """
    pipe = subprocess.PIPE
    command = [os.path.abspath(python), str(_CRAZYFLOW), str(rows)]  # its libraries write files where they run
    with (
        TemporaryDirectory() as folder,
        TemporaryFile("w+") as errors,
        subprocess.Popen(command, cwd=folder, stdin=pipe, stdout=pipe, stderr=errors, text=True) as process,
    ):
        commands, lines = cast(IO[str], process.stdin), cast(IO[str], process.stdout)
        if not (version := lines.readline().strip()):
            process.wait()
            errors.seek(0)
            raise RuntimeError((errors.read().strip().splitlines() or ["no output"])[-1])

        def measure(seconds: float) -> list[float]:
            commands.write(f"{seconds}\n")
            commands.flush()
            return [float(rate) for rate in lines.readline().split()]

        name, step = f"crazyflow {version}", "in single precision"
        yield (
            (
                Contender(
                    name=f"{name}, DroneReachPos-v0", step=f"step of 2 ms {step}, observation and reward", dt=0.002
                ),
                Contender(name=f"{name}, Sim.step", step=f"step of 2 ms {step}, first-principles dynamics", dt=0.002),
            ),
            measure,
        )
        commands.close()


def compared(
    contenders: Sequence[tuple[Sequence[Contender], Measure]], rows: int, rounds: int, seconds: float
) -> tuple[PeerRow, ...]:
    """Rows of ``contenders`` with ``rows`` environments, measured in turn, ``rounds`` times for ``seconds`` each."""
    names = [contender for part, _ in contenders for contender in part]
    table = [[rate for _, measure in contenders for rate in measure(seconds)] for _ in range(rounds + 1)][1:]
    rates = np.median(table, axis=0)
    return tuple(
        PeerRow(
            name=contender.name,
            step=contender.step,
            environments=rows,
            steps_per_second=float(rate),
            simulated_seconds_per_second=float(rate) * contender.dt,
            ratio=float(rates[0] / rate),
        )
        for contender, rate in zip(names, rates, strict=True)
    )


def texts(groups: Mapping[str, Sequence[PeerRow]]) -> Iterator[str]:
    """Each row of ``groups`` in a line."""
    for group, rows in groups.items():
        for row in rows:
            yield (
                f"{group}: {row.name}: {row.steps_per_second:,.0f} steps/s, "
                f"{row.simulated_seconds_per_second:,.0f} simulated s/s, ratio {row.ratio:.2f}"
            )
