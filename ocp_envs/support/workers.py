"""Workers behind an executor, any of which may die at any moment, and those of a Dask cluster.

``distributed`` is used where a caller has imported it.
"""

from __future__ import annotations

import functools
import os
import sys
import time
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ocp_envs.support.pool import WorkerLostError

if TYPE_CHECKING:
    from distributed import Client

#: Seconds between looks at a cluster's size.
LOOK = 5.0


@dataclass(frozen=True)
class Workers:
    """What a program that runs many tasks must know of an executor: how to ``submit`` one, as the executor's.

    ``in_flight`` is how many to have submitted at a time; it is called again and again, as workers may join and leave,
    and raises ``BrokenExecutor`` where no task can run any more. A task that ends in one of the errors ``lost``, whose
    worker died, may be submitted again.
    """

    submit: Callable[..., Future[Any]]
    in_flight: Callable[[], int]
    lost: tuple[type[BaseException], ...] = (WorkerLostError, CancelledError)

    @classmethod
    def of(cls, executor: Executor, count: int | None = None) -> Workers:
        """Workers of any ``executor`` that runs ``count`` tasks at once, by default one per core of this machine.

        The executor of a Dask cluster, ``client.get_executor()``, says itself how many.
        """
        distributed = sys.modules.get("distributed")
        if distributed is None or not isinstance(executor, distributed.cfexecutor.ClientExecutor):
            in_flight = 2 * (count or os.cpu_count() or 1)  # so that no worker waits for its next task
            return cls(executor.submit, lambda: in_flight)
        # Dask returns the earlier result, even the loss of a worker, for a task it has seen, unless it is "impure".
        submit = functools.partial(executor.submit, pure=False)
        client = executor._client  # Dask offers no public way from an executor to its client
        return cls(submit, TasksInFlight(client), (*cls.lost, distributed.KilledWorker))


class TasksInFlight:
    """Twice the number of threads of a cluster, at least two.

    Its ``client`` (a ``distributed.Client``) is asked for them again after ``look`` seconds.
    """

    def __init__(self, client: Client, look: float = LOOK) -> None:
        self._client, self._look = client, look
        self._scheduler = client.scheduler.address if client.scheduler else ""
        self._threads, self._looked = 1, -float("inf")

    def __call__(self) -> int:
        """How many tasks to have submitted now.

        Raises:
            BrokenExecutor: the scheduler is gone, or the client was closed.
        """
        if time.monotonic() - self._looked >= self._look:
            self._threads = self._count()
            self._looked = time.monotonic()
        return 2 * self._threads

    def _count(self) -> int:
        if self._client.status == "closed":
            raise BrokenExecutor(f"the Dask scheduler {self._scheduler} is gone, or its client was closed")
        try:
            threads = sum(self._client.ncores().values())
        except (OSError, TimeoutError):  # the client is reconnecting, and closes itself where that fails
            return self._threads
        if not threads:
            warnings.warn("the Dask cluster has no workers; waiting for some to join", stacklevel=2)
        return max(1, threads)
