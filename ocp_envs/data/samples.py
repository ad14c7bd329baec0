"""Solved problem instances in memory: what a database returns and what learning takes."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array, Ints
from ocp_envs.support.doors import checked
from ocp_envs.support.rows import Batch
from ocp_envs.trajectory import Trajectory


@checked
@dataclass(frozen=True, eq=False)
class Samples(Batch):
    """The best solution of each of M problem instances; :meth:`of` makes samples without costs.

    Args:
        problem: the problem.
        parameters: (M, np).
        trajectory: M optimal trajectories.
        mode: index of each trajectory's solution family, (M,).
        cost: (M,); NaN where unknown.
        multipliers: of the path constraint at the knots, (M, N, nh); NaN where unknown.
        mode_costs: best cost of every family, (M, modes); +inf where no trajectory of it was found, NaN where unknown.
        index: of the instance in its database, (M,).

    Raises:
        ValueError: numbers of parameters, trajectories and families that differ, or trajectories of another problem.
    """

    problem: OptimalControlProblem
    parameters: Array
    trajectory: Trajectory
    mode: Ints
    cost: Array
    multipliers: Array
    mode_costs: Array
    index: Ints

    def __post_init__(self) -> None:
        super().__post_init__()
        count, (states, controls) = len(self.parameters), (self.trajectory.states, self.trajectory.controls)
        if len(self.trajectory) != count or np.shape(self.mode) != (count,):
            raise ValueError(
                f"expected as many trajectories and families as parameters, {count}; got {len(self.trajectory)} "
                f"trajectories and families of shape {np.shape(self.mode)}"
            )
        system, knots = self.problem.system, self.problem.knots
        if states.shape[1:] != (knots, system.nx) or controls.shape[2] != system.nu:
            raise ValueError(
                f"expected trajectories of {self.problem.id} with states ({knots}, {system.nx}) and {system.nu} "
                f"controls, got {states.shape[1:]} and {controls.shape[2]}"
            )

    @classmethod
    @checked
    def of(cls, problem: ProblemOrId, parameters: Array, trajectory: Trajectory, mode: Ints) -> Samples:
        """Samples of ``problem`` whose costs and multipliers are unknown.

        Given are ``parameters`` (M, np), M optimal trajectories ``trajectory`` and their families ``mode`` (M,).
        """
        problem = problem_of(problem)
        count, modes = len(parameters), len(problem.modes)
        unknown = np.full(count, np.nan)
        multipliers = np.full((count, problem.knots, problem.n_clearances), np.nan)
        costs = np.full((count, modes), np.nan)
        return cls(problem, parameters, trajectory, mode, unknown, multipliers, costs, np.arange(count))

    def in_one_turn(self) -> Samples:
        """The same instances with the angles of their parameters in the turn around the centre of the box, where
        planners look for them: these samples themselves where all are in the box already.

        Trajectories are turned as well, and families found anew; costs of all families of a turned sample are unknown.
        """
        within, turns = self.problem.in_one_turn(self.parameters)
        turned = (within != self.parameters).any(axis=1) & ~self.problem.parameters.contains(self.parameters)
        if not turned.any():
            return self
        within = np.where(turned[:, None], within, self.parameters)
        trajectory = self.trajectory.shifted(-turns * turned[:, None])
        mode, costs = np.array(self.mode), np.array(self.mode_costs)
        mode[turned] = self.problem.modes.classify(
            self.problem, within[turned], trajectory[turned], self.multipliers[turned]
        )
        costs[turned] = np.nan
        return replace(self, parameters=within, trajectory=trajectory, mode=mode, mode_costs=costs)

    def with_images(self) -> Samples:
        """These samples and their images under the symmetry of the problem, which are optimal as well.

        Costs of families other than the image's own are unknown, and the image has the index of its original.

        Raises:
            ValueError: the problem declares no symmetry.
        """
        problem, symmetry = self.problem, self.problem.symmetry
        if symmetry is None:
            raise ValueError(f"{problem.id} declares no symmetry, under which samples have images")
        states, contexts = problem.start(self.parameters)
        images = problem.parameters_of(symmetry.states(states), symmetry.contexts(contexts))
        within, turns = problem.in_one_turn(images)
        trajectory = symmetry.trajectories(self.trajectory).shifted(-turns)
        mode = problem.modes.classify(problem, within, trajectory, self.multipliers)
        costs = np.full_like(self.mode_costs, np.nan)
        costs[np.arange(len(mode)), mode] = self.cost
        image = replace(self, parameters=within, trajectory=trajectory, mode=mode, mode_costs=costs)
        joined = {
            name: np.concatenate([getattr(self, name), getattr(image, name)])
            for name in ("parameters", "mode", "cost", "multipliers", "mode_costs", "index")
        }
        return Samples(problem, trajectory=Trajectory.concatenate([self.trajectory, trajectory]), **joined)


@runtime_checkable
class SampleSource(Protocol):
    """What returns samples whose trajectories are all finite, such as a :class:`~ocp_envs.data.database.Database`."""

    def samples(self) -> Samples:
        """All samples."""


def samples_of(data: Samples | SampleSource) -> Samples:
    """The samples of a database, or ``data`` itself if it is samples already, with their angles in one turn.

    Raises:
        TypeError: neither.
        ValueError: no samples, or values that are not finite.
    """
    given = isinstance(data, Samples)
    samples = data if isinstance(data, Samples) else data.samples() if hasattr(data, "samples") else None
    if not isinstance(samples, Samples):
        raise TypeError(f"expected a Database or its samples, got {type(data).__name__}")
    if not len(samples):
        instances = 0 if given or not isinstance(data, Sized) else len(data)
        got = f"none of its {instances} instances is solved" if instances else "got none; solve some instances first"
        raise ValueError(f"expected at least one sample of {samples.problem.id}, {got}")
    if given:  # a database has checked its own
        samples.problem.check_parameters(samples.parameters, extrapolate=True)
        if bad := int((~samples.trajectory.finite).sum()):
            raise ValueError(f"{bad} of {len(samples)} trajectories are not finite; select solved samples only")
    return samples.in_one_turn()
