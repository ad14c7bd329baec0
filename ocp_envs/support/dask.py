"""The workers of a Dask cluster; ``distributed`` is used where a caller has imported it."""

from __future__ import annotations

import functools
import sys
import time
import warnings
from concurrent.futures import BrokenExecutor, Executor
from typing import TYPE_CHECKING

from ocp_envs.support.workers import Workers

if TYPE_CHECKING:
    from distributed import Client

#: Seconds between looks at a cluster's size.
LOOK = 5.0


def workers_of(executor: Executor) -> Workers | None:
    """The workers behind ``client.get_executor()``; ``None`` for an executor that is not Dask's."""
    distributed = sys.modules.get("distributed")
    if distributed is None or not isinstance(executor, distributed.cfexecutor.ClientExecutor):
        return None
    # Dask returns the earlier result, even the loss of a worker, for a task that it has seen, unless it is "impure".
    submit = functools.partial(executor.submit, pure=False)
    in_flight = TasksInFlight(executor._client)  # Dask offers no public way from an executor to its client
    return Workers(submit, in_flight, (*Workers.lost, distributed.KilledWorker))


class TasksInFlight:
    """Twice the number of a cluster's threads, at least two; its size is looked up every few seconds.

    Args:
        client: a ``distributed.Client``.
        look: seconds between looks.
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
