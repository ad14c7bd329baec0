"""The nearest stored solution as a planner."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.model_files import ModelFile, Tensors, write_model
from moe_policy.planners import fixed_point
from ocp_envs.data.neighbours import Neighbours
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.system import Box
from ocp_envs.trajectory import Trajectory


class NearestPlanner:
    """The stored solution of the nearest stored parameter, every coordinate of p divided by the width of its box.

    Args:
        database: a Database or its samples.
        name: short name for tables.
    """

    @checked
    def __init__(self, database: Samples | SampleSource, name: str = "nearest") -> None:
        samples = samples_of(database)
        self.problem, self.name = samples.problem, name
        self.parameters, self.trajectory, self.mode = samples.parameters, samples.trajectory, samples.mode
        self._stored = Neighbours(self.problem.parameters, self.parameters)

    def __repr__(self) -> str:
        return f"NearestPlanner({self.problem.id!r}, {self.name!r}, {len(self.parameters)} trajectories)"

    def samples(self) -> Samples:
        """What is stored, as samples to learn from or for warm starts."""
        return Samples.of(self.problem, self.parameters, self.trajectory, self.mode)

    @checked
    def neighbours(self, p: ArrayLike, k: int = 1) -> Ints:
        """Rows (B, k) of the ``k`` stored parameters that are nearest to ``p`` (B, np) or (np,), nearest first."""
        check_whole("k", k, 1, len(self.parameters))
        return self._rows(self.problem.in_one_turn(p)[0], k)

    def _rows(self, within: Array, k: int) -> Ints:
        return self._stored.nearest(within, k)[1]

    def __call__(self, p: ArrayLike) -> Trajectory:
        """Plans of parameters ``p`` (B, np) or (np,), their angles in any turn."""
        within, turns = self.problem.in_one_turn(p)
        return self.trajectory[self._rows(within, 1)[:, 0]].shifted(turns)

    @property
    def parameters_total(self) -> int:
        """Number of stored values."""
        return len(self.parameters) * (len(self.problem.parameters) + self.problem.flat_size)

    @property
    def parameters_active(self) -> int:
        """Number of values that take part in one plan."""
        return len(self.problem.parameters) + self.problem.flat_size

    def rounded(self) -> NearestPlanner:
        """This planner with trajectories rounded to about one part in 4096 of the range of each of their coordinates
        and parameters rounded to single precision, whose files are a quarter as large. The shipped one is rounded like
        this.
        """
        parameters = _in_single_precision(self.parameters, self.problem.parameters)
        trajectory = fixed_point.rounded(self.trajectory)
        return NearestPlanner(Samples.of(self.problem, parameters, trajectory, self.mode), self.name)

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``<path>.safetensors`` and ``<path>.json``; parameters exactly, trajectories in float32 or, where they
        are :meth:`rounded`, packed without any loss.
        """
        packed = fixed_point.packed(self.trajectory)
        tensors: Tensors = {
            "parameters": self.parameters,
            "modes": self.mode.astype(np.int64),
            **({"trajectories": self.trajectory.flat().astype(np.float32)} if packed is None else packed),
        }
        write_model(path, "nearest", self.problem, tensors, {"name": self.name})


def _in_single_precision(parameters: Array, box: Box) -> Array:
    """The ``parameters`` (M, np) as numbers of single precision that rounding does not move out of the ``box``."""
    single = parameters.astype(np.float32)
    below = np.nextafter(single, np.float32(-np.inf))
    above = np.nextafter(single, np.float32(np.inf))
    return np.where(single > box.upper, below, np.where(single < box.lower, above, single)).astype(np.float64)


def read_nearest(file: ModelFile, problem: OptimalControlProblem) -> NearestPlanner:
    """The planner for ``problem`` that :meth:`NearestPlanner.save` wrote to ``file``."""
    tensors = file.tensors
    if "trajectories" in tensors:
        trajectory = problem.unflatten(tensors["trajectories"].astype(np.float64))
    else:
        trajectory = fixed_point.unpacked(tensors)
    stored = Samples.of(problem, tensors["parameters"].astype(np.float64), trajectory, tensors["modes"])
    return NearestPlanner(stored, file.description["name"])
