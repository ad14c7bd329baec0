"""What a program that runs many tasks must know about an executor, beyond how to submit a task."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from dataclasses import dataclass
from typing import Any

from ocp_envs.support.pool import WorkerLostError


@dataclass(frozen=True)
class Workers:
    """Workers behind an executor, any of which may die at any moment.

    Args:
        submit: as the executor's: a function and its arguments → the future of its result.
        in_flight: how many tasks to have submitted at a time; called again and again, as workers may join and leave.
            Raises ``BrokenExecutor`` where no task can run any more.
        lost: errors of a task whose worker died; such a task may be submitted again.
    """

    submit: Callable[..., Future[Any]]
    in_flight: Callable[[], int]
    lost: tuple[type[BaseException], ...] = (WorkerLostError, CancelledError)

    @classmethod
    def of(cls, executor: Executor, count: int | None = None) -> Workers:
        """Workers of an executor that says nothing about itself.

        Args:
            executor: any executor.
            count: tasks that it runs at once; by default one per core of this machine.
        """
        in_flight = 2 * (count or os.cpu_count() or 1)  # so that no worker waits for its next task
        return cls(executor.submit, lambda: in_flight)
