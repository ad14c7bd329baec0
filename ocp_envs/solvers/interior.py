"""An interior-point method for programs of stages, in C: an iteration takes a tenth of the time of fatrop's.

The method is in ``interior.c``, its barrier problem in ``barrier.c`` and its Newton steps by the Riccati recursion in
``recursion.c``; the functions of a stage are fused (:mod:`ocp_envs.solvers.fused`), and all sizes are known to the
compiler. It covers every transcribed program whose functions consist of scalar instructions and are not too long, and
needs a C compiler.
"""

from __future__ import annotations

import ctypes
import enum
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ocp_envs.solvers.fused import MOST_INSTRUCTIONS, stage_functions
from ocp_envs.solvers.nlp import Outcome, SolverSettings, Status, Task
from ocp_envs.solvers.plugins import Again
from ocp_envs.solvers.transcription import Transcription
from ocp_envs.support import kernels
from ocp_envs.support.arrays import Array, Ints, address
from ocp_envs.support.compiler import NATIVE, compiled, written_by
from ocp_envs.support.programs import entry

_PROGRAM = [Path(__file__).with_name(name) for name in ("recursion.c", "barrier.c", "interior.c")]
#: Sums are ordered such that vectors can form them; what is not finite stays so.
FLAGS = ("-O3", *NATIVE, "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-w")
#: More takes minutes, and gains nothing, for the straight lines of the functions.
_OF_FUNCTIONS = ("#pragma GCC push_options", '#pragma GCC optimize("O1")'), ("#pragma GCC pop_options",)
_UNBOUNDED = 1e20


class _Ended(enum.IntEnum):
    """How a run ended, as in ``interior.c``."""

    CONVERGED = 0
    STUCK = 1
    NOT_FINITE = 2


_OUTCOMES = {
    _Ended.CONVERGED: Outcome.CONVERGED,
    _Ended.STUCK: Outcome.STUCK,
    _Ended.NOT_FINITE: Outcome.BROKE_DOWN,
}


class _Limits(ctypes.Structure):
    _fields_ = (("tolerance", ctypes.c_double), ("iterations", ctypes.c_longlong))


class InteriorPoint:
    """The method of ``library`` for the program ``transcription``, as ``settings`` say; see :meth:`of`."""

    again = (
        Again(0.75, from_guess=False),
        Again(0.75, from_guess=False),
        Again(1.0, from_guess=True),
        Again(0.5, from_guess=False),
    )

    def __init__(self, library: ctypes.CDLL, transcription: Transcription, settings: SolverSettings) -> None:
        self._transcription, self._settings = transcription, settings
        self._order = _order(transcription)
        shape, constraints = transcription.present.shape, max(len(self._order), 1)
        size, self._ended = np.zeros(1, dtype=np.int64), np.zeros(2, dtype=np.int64)
        entry(library, "workspace", "p")(address(size))
        self._workspace = np.zeros(int(size[0]) // 8 + 1)
        self._z, self._lower, self._upper = np.zeros(shape), np.full(shape, -_UNBOUNDED), np.full(shape, _UNBOUNDED)
        self._least, self._multipliers = np.zeros(constraints), np.zeros(constraints)
        self._context, self._limits = np.zeros(max(transcription.interval.size1_in(1), 1)), _Limits()
        # w is the table of all stages without its first state and its last control.
        variables = slice(transcription.nx, self._z.size - transcription.nu)
        self.w, self._of_w = self._z.ravel()[variables], [a.ravel()[variables] for a in (self._lower, self._upper)]
        self.cost, self.lam_g = np.zeros(1), np.zeros(transcription.nlp.numel_out("g"))
        arrays = self._z, self._lower, self._upper, self._least, self._context, self._multipliers, self.cost
        first = [address(self._workspace), ctypes.addressof(self._limits)]
        self._arguments = [*first, *map(address, arrays), address(self._ended)]
        self._solve = entry(library, "solve", "p" * len(self._arguments))

    @classmethod
    def of(cls, transcription: Transcription, settings: SolverSettings) -> InteriorPoint | None:
        """The method for ``transcription`` with ``settings``; ``None`` if it is not covered or without a compiler."""
        stages = (transcription.interval, transcription.clearance, transcription.mixed, transcription.final)
        if not all(kernels.vectorisable(f) and f.n_instructions() <= MOST_INSTRUCTIONS for f in stages):
            return None
        files = "\n".join(path.read_text() for path in _PROGRAM)
        sizes = "".join(f"#define {name} {value}\n" for name, value in _sizes(transcription).items())

        def write() -> str:
            begin, end = _OF_FUNCTIONS
            return "\n".join([*begin, kernels.source(stage_functions(transcription)), *end, sizes, files])

        written = written_by(__name__, kernels.__name__, stage_functions.__module__)
        content = (transcription.nlp.serialize(), sizes, files, written)
        library = compiled("interior", content, write, FLAGS, lambda path: ctypes.CDLL(str(path)))
        return None if library is None else cls(library, transcription, settings)

    def run(self, task: Task, lower: Array, upper: Array) -> tuple[Outcome, int]:
        """Solve ``task`` into ``w``, ``cost`` and ``lam_g``, with bounds ``lower`` and ``upper`` (nw,) of w.

        Returns:
            how it ended, and the number of iterations.
        """
        program, nx = self._transcription, self._transcription.nx
        self.w[:], self._z[0, :nx] = task.guess, task.parameter[:nx] / program.state_scale
        self._of_w[0][:], self._of_w[1][:] = lower, upper
        self._context[: len(task.parameter) - nx] = task.parameter[nx:]
        if len(self._order):
            self._least[:] = 0.0 if task.margin is None else program.lower_sides(task.margin)[self._order]
        self._limits.tolerance = self._settings.tolerance
        self._limits.iterations = self._settings.max_iterations if task.iterations is None else task.iterations
        self._solve(*self._arguments)
        self.lam_g[self._order] = -self._multipliers[: len(self._order)]
        return _OUTCOMES[_Ended(int(self._ended[0]))], int(self._ended[1])

    def status(self, outcome: Outcome) -> Status:
        """The status of a solve that ended with the ``outcome`` of the last run."""
        if outcome is Outcome.CONVERGED:
            return Status.SOLVED
        return Status.NOT_FINITE if outcome is Outcome.BROKE_DOWN else Status.NOT_CONVERGED


def _sizes(program: Transcription) -> Mapping[str, int]:
    """The sizes of ``program`` as the C has them."""
    counts = program.counts
    of_constraints = {"NC": counts.clearances, "NI": counts.mixed[0], "NE": counts.mixed[1]}
    at_end = {"FI": counts.final[0], "FE": counts.final[1]}
    of_stages = {"NX": program.nx + 1, "NU": program.nu, "K": program.intervals, "NS": program.interval.size1_in(1)}
    return {**of_stages, **of_constraints, **at_end}


def _order(program: Transcription) -> Ints:
    """The index in g of each constraint in the order of the stages; that of any for clearances at the first stage."""
    rows = program.rows
    clearances = np.concatenate([np.zeros_like(rows.clearances[:1]), rows.clearances[:-1]])
    within = np.concatenate([clearances, rows.mixed], axis=1)
    return np.concatenate([within.ravel(), rows.clearances[-1], rows.final])
