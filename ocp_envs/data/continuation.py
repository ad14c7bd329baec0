"""Which neighbouring instances belong together: the optimum of one, as a warm start at the other, leads to its optimum.

Two instances i and j that are neighbours in p are compared in both directions. From the optimum of i the solver finds a
trajectory at p_j; the *distance* is how far this is from the stored optimum of j,

    d = max( max_k ‖x_k − x_k*‖_∞ , |t_f − t_f*| / t_max )

with states divided by their scales. It is small where the optimum depends continuously on p between the two.
*Measured* with eight neighbours, d is below 1e-3 or above 0.15 on the pendulum, the vehicle and both quadcopters, and
nothing lies between. The *excess* is how much more the trajectory costs, (J − J*) / |J*|: below zero, the stored one is
not the optimum. It does not decide, since at a discontinuity both families cost the same.

The angles of p are written in one turn, and no neighbours are looked for across its ends: planners see p as a vector,
for which the two ends are far apart.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from ocp_envs.data.continuation_files import ContinuationFiles, Continued
from ocp_envs.data.locks import only_writer
from ocp_envs.data.neighbours import neighbour_pairs
from ocp_envs.data.samples import Samples
from ocp_envs.data.worker import kept_solver, start_from
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.solvers.check import residuals
from ocp_envs.solvers.guesses import NEAREST_WINDING
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.solvers.solver import OF_MANY_GUESSES, GuardedSolver
from ocp_envs.support.arrays import Array, Bools, Ints
from ocp_envs.support.checks import check_whole
from ocp_envs.support.progress import Progress
from ocp_envs.support.tasks import TaskRun, workers_of
from ocp_envs.trajectory import Trajectory

Floats = NDArray[np.float32]
#: Largest distance with which a solve has led to the stored optimum.
DISTANCE = 1e-2
#: Instances whose trajectories are hashed at a time.
_BLOCK = 10_000


@dataclass(frozen=True, eq=False)
class Continuation:
    """What continuation says of E pairs of neighbouring samples, by row of the samples.

    Args:
        pairs: the two samples i < j of each, (E, 2).
        distance: at j from the optimum of i, and at i from the optimum of j, (E, 2); +inf where nothing was found.
        excess: of the cost, likewise.
        iterations: of the solver, likewise.
    """

    pairs: Ints
    distance: Floats
    excess: Floats
    iterations: NDArray[np.int32]

    @property
    def agrees(self) -> Bools:
        """Which solves led to the stored optimum, (E, 2)."""
        return np.asarray(self.distance <= DISTANCE)

    @property
    def joined(self) -> Bools:
        """Which pairs belong to one family, as far as the two alone can tell: both solves agree, (E,)."""
        return np.asarray(self.agrees.all(axis=1))


class _Task(NamedTuple):
    """The pairs of the chunk ``number``, of the pickled ``problem``: ``parameters`` (B, 2, np), optima ``z``."""

    number: int
    problem: bytes
    settings: SolverSettings
    parameters: Array
    z: Floats


def continued(
    samples: Samples,
    kept: Path | None = None,
    *,
    neighbours: int = 8,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: bool | None = None,
) -> Continuation:
    """Compare all neighbouring samples in both directions.

    The same call resumes where an earlier one was interrupted, if its results are kept. Memory: some hundred bytes for
    each sample, apart from the samples themselves.

    Args:
        samples: M optimal trajectories.
        kept: folder in which results are kept, one Zarr group for each set of samples; by default they are not kept.
        neighbours: number of neighbours in p with which each sample is compared, every coordinate divided by the width
            of its box.
        executor: any ``concurrent.futures`` executor; by default a pool of processes, with which the calling script
            needs Python's usual ``if __name__ == "__main__":``.
        workers: processes of the default pool, or tasks that ``executor`` runs at once; one per core where not given.
        progress: show it, as :func:`ocp_envs.generate` does.

    Raises:
        DatabaseError: what is kept is damaged, or another process is writing it.
        ValueError: ``neighbours`` below 1.
    """
    check_whole("neighbours", neighbours)
    if kept is None:
        with tempfile.TemporaryDirectory(prefix="ocp_envs-") as folder:
            return continued(
                samples, Path(folder), neighbours=neighbours, executor=executor, workers=workers, progress=progress
            )
    pairs = neighbour_pairs(samples.problem.parameters, samples.parameters, neighbours)
    key = _key(samples, pairs, OF_MANY_GUESSES)
    path = kept / f"continuation-{key[:12]}.zarr"
    with only_writer(path):
        files = ContinuationFiles.open_or_create(path, samples.problem, key, len(pairs))
        _finish(files, samples, pairs, executor, workers, progress)
    found = files.read()
    return Continuation(pairs, found.distance, found.excess, found.iterations)


def _key(samples: Samples, pairs: Ints, settings: SolverSettings) -> str:
    """A hash of everything that the results depend on."""
    sha = hashlib.sha256(json.dumps([samples.problem.fingerprint, asdict(settings)], sort_keys=True).encode())
    sha.update(samples.parameters.tobytes())
    for begin in range(0, len(samples), _BLOCK):
        sha.update(samples.trajectory[begin : begin + _BLOCK].flat().tobytes())
    sha.update(pairs.tobytes())
    return sha.hexdigest()


def _finish(
    files: ContinuationFiles,
    samples: Samples,
    pairs: Ints,
    executor: Executor | None,
    workers: int | None,
    progress: bool | None,
) -> None:
    """Solve what is missing."""
    problem, missing = samples.problem, files.missing()
    if not missing:
        return
    with GuardedSolver(problem, OF_MANY_GUESSES) as solver:
        solver.start()  # compiles, once, before workers ask for it
    done = len(pairs) - sum(files.rows(number).stop - files.rows(number).start for number in missing)
    bar = Progress(len(pairs), unit="pair", label=f"{problem.id}, continuation", initial=done, shown=progress)

    def take(task: _Task, found: Continued) -> None:
        files.write(task.number, found)
        bar.update(len(found))

    with bar, workers_of(executor, workers) as pool:
        TaskRun(continue_pairs, pool, take)(_tasks(files, samples, pairs, missing))


def _tasks(files: ContinuationFiles, samples: Samples, pairs: Ints, missing: list[int]) -> Iterator[_Task]:
    """The tasks of the chunks ``missing``."""
    payload = cloudpickle.dumps(samples.problem)
    for number in missing:
        wanted = pairs[files.rows(number)]
        flat = samples.trajectory[wanted.ravel()].flat().astype(np.float32)
        yield _Task(
            number, payload, OF_MANY_GUESSES, samples.parameters[wanted], flat.reshape(*wanted.shape, flat.shape[-1])
        )


def continue_pairs(task: _Task) -> Continued:
    """Solve both directions of all pairs of ``task``, in a process that keeps a solver child for each thread."""
    solver = kept_solver(task.problem, task.settings)
    problem, count = solver.problem, len(task.parameters)
    p = task.parameters.reshape(2 * count, -1)
    wanted = problem.unflatten(task.z.reshape(2 * count, -1).astype(np.float64))
    warm = start_from(problem, p, task.z[:, ::-1].reshape(2 * count, -1))
    nearest = np.full(len(p), NEAREST_WINDING)
    found = solver.solve(p, warm, nearest, retry_with_fallback=False, rescue=False)
    _, cost = residuals(problem, p, wanted)

    def directions(values: NDArray[np.generic]) -> NDArray[np.generic]:
        """``values`` (2B,) at i and j of each pair as those at j, from i, and at i, from j."""
        return values.reshape(count, 2)[:, ::-1]

    with np.errstate(invalid="ignore", divide="ignore"):
        excess = np.where(found.solved, (found.cost - cost) / np.abs(cost), np.inf)
    apart = np.where(found.solved, distance(problem, found.trajectory, wanted), np.inf)
    return Continued(
        directions(apart).astype(np.float32),
        directions(excess).astype(np.float32),
        directions(found.iterations).astype(np.int32),
    )


def distance(problem: OptimalControlProblem, found: Trajectory, wanted: Trajectory) -> Array:
    """The distances d of B trajectories ``found`` of ``problem`` from those ``wanted``, (B,)."""
    states = np.abs((found.states - wanted.states) / problem.system.state.scale).max(axis=(1, 2))
    return np.asarray(np.maximum(states, np.abs(found.duration - wanted.duration) / problem.horizon.longest))
