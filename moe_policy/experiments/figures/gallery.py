"""The figures of a problem by name: what they show, and how they are drawn from samples and planners.

Which figures a problem has follows from its declaration: one with two parameters is drawn over its box, one whose
trajectories are paths in the plane or in space as paths, and one with path constraints shows violations. Figure numbers
are those of Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.figures import clusters, errors, plane, space
from moe_policy.experiments.figures.details import (
    Case,
    DiscontinuityCase,
    MeanViolations,
    PartitionSizes,
    RiseCase,
    Sizes,
)
from moe_policy.experiments.figures.rise import (
    find_discontinuity,
    follow,
    plan_violations,
    rise_figure,
    rise_parameters,
)
from moe_policy.learning.clustering import Labels, cluster
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.reports.records import Record
from moe_policy.rollouts.episodes import Episodes
from moe_policy.score.method import Method
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.solvers.solver import GuardedSolver
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: Training samples drawn around the case where the single network interpolates.
NEIGHBOURS = 8


@dataclass(frozen=True, eq=False)
class Material:
    """What figures are drawn from."""

    training: Samples  # solved training instances
    validation: Samples  # solved validation instances
    planners: Mapping[str, NetworkPlanner]  # trained networks by name
    #: numbers of clusters of the k-means partitions that are shown next to the solution families
    partitions: tuple[int, ...] = ()

    @property
    def problem(self) -> OptimalControlProblem:
        """The problem of the samples."""
        return self.training.problem

    @cached_property
    def families(self) -> Labels:
        """The training samples by solution family."""
        return cluster(self.training, "custom")

    @cached_property
    def labels(self) -> dict[str, Labels]:
        """The partitions of the training samples by name, the solution families first."""
        kmeans = {f"k-means {k}": cluster(self.training, "kmeans", k=k) for k in self.partitions}
        return {"custom": self.families, **kmeans}

    @cached_property
    def clusters(self) -> Labels:
        """The families, or where there is but one, the first partition with more than one cluster."""
        several = self.families.k > 1 or not self.partitions
        return self.families if several else next(labels for labels in self.labels.values() if labels.k > 1)

    @cached_property
    def episodes(self) -> dict[str, Episodes]:
        """The plans of all planners for the validation instances, tracked."""
        p = self.validation.parameters
        return {
            name: comparison.run(self.problem, Method(name, planner), p, batches=())[1]
            for name, planner in self.planners.items()
        }

    @cached_property
    def errors(self) -> dict[str, tuple[Array, Array]]:
        """(error of the predicted final state, error at the evaluation time) by planner, each (B,)."""
        p = self.validation.parameters
        return {
            name: (self.problem.goal_error(planner(p).states[:, -1]), self.episodes[name].final_error)
            for name, planner in self.planners.items()
        }

    @property
    def pair(self) -> dict[str, NetworkPlanner]:
        """The single network, and the mixture over the solution families or else the first one."""
        mixture = min((name for name in self.planners if name != "snn"), key=lambda name: name != "moe-custom")
        return {name: self.planners[name] for name in ("snn", mixture)}


#: Draws a figure at a path and returns what there is to say about it.
Draw = Callable[[Material, Path], Record | None]


@dataclass(frozen=True)
class Drawing:
    """A figure."""

    draw: Draw  # draws it
    shows: str  # what it shows
    paper: int | None = None  # number of the paper's figure of that kind, if there is one


def _jump(material: Material, path: Path) -> DiscontinuityCase:
    validation = material.validation
    differences = relative_cost_difference(validation.mode_costs)
    chosen = int(differences.argmin())
    p = validation.parameters[chosen]
    plans = {name: planner(p) for name, planner in material.pair.items()}
    optimal = validation.trajectory[chosen]
    clusters.discontinuity_figure(path, material.training, material.families, optimal, plans)
    return DiscontinuityCase(parameters=tuple(p.tolist()), cost_difference=float(differences[chosen]))


def _clusters(material: Material, path: Path) -> PartitionSizes:
    clusters.clusters_figure(path, material.training, material.labels)
    return PartitionSizes(sizes={name: tuple(map(int, labels.sizes)) for name, labels in material.labels.items()})


def _errors(material: Material, path: Path) -> None:
    errors.error_figure(path, material.errors, material.problem.goal.radius)


def _histograms(material: Material, path: Path) -> None:
    shown = {name: material.errors[name] for name in material.pair}
    errors.error_histograms_figure(path, shown, material.problem.goal.radius)


def _samples(material: Material, path: Path) -> Sizes:
    picture = material.problem.picture
    module = space if picture is not None and picture.dimensions == 3 else plane
    module.samples_figure(path, material.training, material.clusters)
    return Sizes(sizes=tuple(map(int, material.clusters.sizes)))


def _histories(material: Material, path: Path) -> None:
    clusters.histories_figure(path, material.training, material.clusters)


def _interpolation(material: Material, path: Path) -> Case:
    training, validation, pair = material.training, material.validation, material.pair
    single, mixture = pair.values()
    chosen = plane.choose_interpolated(validation, single, mixture, training, NEIGHBOURS)
    p = validation.parameters[chosen]
    around = NearestPlanner(training).neighbours(p, NEIGHBOURS)[0]
    plans = {name: planner(p) for name, planner in pair.items()}
    optimal = validation.trajectory[chosen]
    plane.interpolation_figure(path, optimal, training[around], plans, material.problem)
    return Case(parameters=tuple(p.tolist()))


def _violations(material: Material, path: Path) -> MeanViolations:
    # A plan that was rejected has no knots.
    found = {name: episodes.knot_violation for name, episodes in material.episodes.items()}
    found = {name: values[np.isfinite(values)] for name, values in found.items()}
    errors.violations_figure(path, found, "rollouts that enter the sphere")
    return MeanViolations(mean={name: float(values.mean()) for name, values in found.items()})


def _around(material: Material, path: Path) -> Case:
    parameters = benchmark_of(material.problem).figures.around
    assert parameters is not None
    space.around_figure(path, material.training, material.families, parameters)
    return Case(parameters=parameters)


def _flip(material: Material, path: Path) -> RiseCase:
    problem, rise = material.problem, benchmark_of(material.problem).figures.rise
    assert rise is not None
    p = rise_parameters(problem, rise)
    with GuardedSolver(problem) as solver:
        (rising, up), (falling, down) = (follow(problem, solver, order) for order in (p, p[::-1]))
    back, down = np.arange(len(p))[::-1], down[::-1]
    both = Trajectory.concatenate([rising, falling[back]])
    optimal = both[np.where(up <= down, np.arange(len(p)), len(p) + np.arange(len(p)))]
    plans = {name: planner(p) for name, planner in material.planners.items()}
    rise_figure(path, problem, p, optimal, plans)
    violations = {name: plan_violations(problem, p, batch) for name, batch in {"optimal": optimal, **plans}.items()}
    row = find_discontinuity(optimal)
    return RiseCase(
        parameters=tuple(map(tuple, p.tolist())),
        costs_from_below=_finite(up),
        costs_from_above=_finite(down),
        between=(float(p[row, 2]), float(p[row + 1, 2])),
        violations={name: _finite(values) for name, values in violations.items()},
    )


def _finite(values: Array) -> tuple[float | None, ...]:
    return tuple(float(value) if np.isfinite(value) else None for value in values)


_BOX = {
    "jump": Drawing(_jump, "what a single network and a mixture predict at a discontinuity", 1),
    "errors": Drawing(_errors, "error of the predicted end against the error after tracking", 3),
    "clusters": Drawing(_clusters, "clusters over the parameter box", 4),
}
_PLANE = {
    "samples": Drawing(_samples, "optimal trajectories by cluster", 5),
    "interpolation": Drawing(_interpolation, "a state where the single network averages over families", 5),
    "histories": Drawing(_histories, "state histories by cluster", 6),
    "errors": Drawing(_histograms, "predicted and tracked final errors", 7),
}
_SPACE = {
    "samples": Drawing(_samples, "optimal trajectories by cluster", 9),
    "errors": Drawing(_histograms, "predicted and tracked final errors"),
}
_AROUND = Drawing(_around, "optimal paths of neighbouring instances", 8)
_FLIP = Drawing(_flip, "where the optimum changes sides", 10)
_VIOLATIONS = Drawing(_violations, "violations of the path constraint", 11)


def drawings(problem: OptimalControlProblem) -> Mapping[str, Drawing]:
    """The figures of ``problem`` by name."""
    if problem.picture is not None and problem.picture.dimensions == 3:
        cases = benchmark_of(problem).figures
        around = {"around": _AROUND} if cases.around else {}
        flip = {"flip": _FLIP} if cases.rise else {}
        violations = {"violations": _VIOLATIONS} if problem.n_clearances else {}
        return MappingProxyType(_SPACE | around | flip | violations)
    return MappingProxyType(_BOX if len(problem.parameters) == 2 else _PLANE)
