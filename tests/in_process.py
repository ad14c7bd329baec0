"""A solver without a child process: for tests that replace parts of it, or have no time to start one."""

from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.nlp_solver import NlpSolver
from ocp_envs.solvers.solver import GuardedSolver


class InProcess:
    """Runs solves in this process; ``nlp`` is what solves."""

    restarts = 0

    def __init__(self, transcription, settings):
        self.nlp = NlpSolver(transcription, settings)

    def solve(self, tasks):
        return [self.nlp.solve(task) for task in tasks]

    def start(self):
        pass

    def close(self):
        pass


class Solver(GuardedSolver):
    """A solver that hangs its caller where it hangs."""

    def __init__(self, problem, settings=None):
        super().__init__(problem, settings or SolverSettings(), InProcess)
