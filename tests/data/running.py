"""Small generations in this process, for tests."""

from concurrent.futures import Executor, Future

import numpy as np

from ocp_envs.data.settings import GenerationSettings
from tests.in_process import Solver

SMALL = GenerationSettings(first=20, chunk=10, starts=2)


COUNT = 80


class InProcess(Executor):
    """Runs a task when it is submitted; notes which ones."""

    def __init__(self):
        self.tasks = []

    def submit(self, fn, /, *args, **kwargs):
        self.tasks.append(args[0])
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Unguarded(Solver):
    """A solver in this process that records which windings it was asked for."""

    asked: list[np.ndarray] = []  # noqa: RUF012 - shared on purpose

    def solve(self, parameters, guesses, windings, *, retry_with_fallback=True):
        self.asked.append(windings)
        return super().solve(parameters, guesses, windings, retry_with_fallback=retry_with_fallback)
