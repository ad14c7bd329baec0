"""Solved problem instances in memory: what a database hands out and what learning takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Samples(Batch):
    """The best solution of each of M problem instances; :meth:`of` makes samples without costs.

    Args:
        problem: the problem.
        parameters: (M, np).
        trajectory: M optimal trajectories.
        mode: the solution family each belongs to, as a row of the problem's mode names, (M,).
        cost: (M,); NaN where unknown.
        multipliers: of the path constraint at the knots, (M, N, nh); NaN where unknown.
        mode_costs: best cost of every mode, +inf where no trajectory of it was found, NaN where unknown, (M, modes).
        index: number of the instance in its database, (M,).
    """

    problem: OptimalControlProblem
    parameters: Array
    trajectory: Trajectory
    mode: NDArray[np.int64]
    cost: Array
    multipliers: Array
    mode_costs: Array
    index: NDArray[np.int64]

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, parameters: Array, trajectory: Trajectory, mode: NDArray[np.int64]
    ) -> Samples:
        """Samples whose costs and multipliers are unknown."""
        count, modes = len(parameters), len(problem.modes)
        unknown = np.full(count, np.nan)
        multipliers = np.full((count, problem.knots, problem.n_clearances), np.nan)
        costs = np.full((count, modes), np.nan)
        return cls(problem, parameters, trajectory, mode, unknown, multipliers, costs, np.arange(count))


class SampleSource(Protocol):
    """What can hand out samples; ``ocp_envs.Database`` can."""

    def samples(self) -> Samples: ...


def samples_of(data: Samples | SampleSource) -> Samples:
    """The samples of a database, or ``data`` itself if it is samples already.

    Raises:
        TypeError: neither.
        ValueError: no samples, disagreeing lengths, or values that are not finite.
    """
    samples = data if isinstance(data, Samples) else data.samples() if hasattr(data, "samples") else None
    if not isinstance(samples, Samples):
        raise TypeError(f"expected a Database or its samples, got {type(data).__name__}")
    count = len(samples)
    if count == 0 or len(samples.trajectory) != count or np.shape(samples.mode) != (count,):
        raise ValueError(
            f"expected as many trajectories and modes as parameters and at least one; got {count} parameters, "
            f"{len(samples.trajectory)} trajectories, modes of shape {np.shape(samples.mode)}"
        )
    samples.problem.check_parameters(samples.parameters, extrapolate=True)
    if samples.trajectory[:1].flat().shape[1] != samples.problem.flat_size:
        raise ValueError(f"the trajectories do not have the layout of {samples.problem.id}")
    if not samples.trajectory.finite.all():
        bad = int((~samples.trajectory.finite).sum())
        raise ValueError(f"{bad} of {count} trajectories are not finite; select solved samples only")
    return samples
