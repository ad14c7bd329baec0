"""The figures of a problem by name: what they show, and how they are drawn from samples and planners.

Which figures a problem has follows from what it is: one with two parameters is drawn over its box, one whose
trajectories are paths in the plane or in space as paths, and one with path constraints shows who violates them. Figure
numbers are those of Tang & Hauser, *Discontinuity-Sensitive Optimal Control Learning by Mixture of Experts* (2019).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from moe_policy.experiments import comparison
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.figures import phase as figures
from moe_policy.experiments.figures import plane as trajectory_figures
from moe_policy.experiments.figures import space as space_figures
from moe_policy.experiments.figures.cases import find_flip, flip_parameters, plan_violations
from moe_policy.experiments.methods import Method
from moe_policy.learning.clustering import Labels, cluster
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.rollouts.episodes import Episodes
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import relative_cost_difference
from ocp_envs.solvers.solver import GuardedSolver, solve
from ocp_envs.support.arrays import Array
from ocp_envs.trajectory import Trajectory

#: Training samples drawn around the case where the single network interpolates.
NEIGHBOURS = 8


@dataclass(frozen=True, eq=False)
class Material:
    """What figures are drawn from.

    Args:
        training: solved training problems.
        validation: solved validation problems.
        planners: trained networks by name.
        partitions: numbers of clusters of the k-means partitions that are shown beside the problem's own modes.
    """

    training: Samples
    validation: Samples
    planners: Mapping[str, NetworkPlanner]
    partitions: tuple[int, ...] = ()

    @property
    def problem(self) -> OptimalControlProblem:
        return self.training.problem

    @cached_property
    def families(self) -> Labels:
        """The training samples by the problem's own modes."""
        return cluster(self.training, "custom")

    @cached_property
    def labels(self) -> dict[str, Labels]:
        """The partitions of the training samples by name, the problem's own modes first."""
        kmeans = {f"k-means {k}": cluster(self.training, "kmeans", k=k) for k in self.partitions}
        return {"custom": self.families, **kmeans}

    @cached_property
    def clusters(self) -> Labels:
        """The families, or where there is but one, the first partition with more than one cluster."""
        several = self.families.k > 1 or not self.partitions
        return self.families if several else next(labels for labels in self.labels.values() if labels.k > 1)

    @cached_property
    def episodes(self) -> dict[str, Episodes]:
        """The plans of all planners for the validation problems, tracked."""
        starts = self.validation.parameters
        return {
            name: comparison.run(self.problem, Method(name, planner), starts, batches=())[1]
            for name, planner in self.planners.items()
        }

    @cached_property
    def errors(self) -> dict[str, tuple[Array, Array]]:
        """(error of the predicted final state, error at the judging time) by planner, each (B,)."""
        p = self.validation.parameters
        return {
            name: (self.problem.goal_error(planner(p).states[:, -1]), self.episodes[name].final_error)
            for name, planner in self.planners.items()
        }

    @property
    def pair(self) -> dict[str, NetworkPlanner]:
        """The single network, and the mixture over the problem's own modes or else the first one."""
        mixture = min((name for name in self.planners if name != "snn"), key=lambda name: name != "moe-custom")
        return {name: self.planners[name] for name in ("snn", mixture)}


#: Draws a figure at a path; what there is to tell about it, as JSON.
Draw = Callable[[Material, Path], dict[str, Any]]


@dataclass(frozen=True)
class Drawing:
    """A figure.

    Args:
        draw: makes it.
        shows: what it shows, in words.
        paper: number of the paper's figure of that kind, if there is one.
    """

    draw: Draw
    shows: str
    paper: int | None = None


def _jump(material: Material, path: Path) -> dict[str, Any]:
    validation = material.validation
    differences = relative_cost_difference(validation.mode_costs)
    chosen = int(differences.argmin())
    p = validation.parameters[chosen]
    plans = {name: planner(p) for name, planner in material.pair.items()}
    optimal = validation.trajectory[chosen]
    figures.discontinuity_figure(path, material.training, material.families, optimal, plans)
    return {"parameters": p, "relative_cost_of_the_second_mode": float(differences[chosen])}


def _clusters(material: Material, path: Path) -> dict[str, Any]:
    figures.clusters_figure(path, material.training, material.labels)
    return {"sizes": {name: labels.sizes for name, labels in material.labels.items()}}


def _errors(material: Material, path: Path) -> dict[str, Any]:
    figures.error_figure(path, material.errors, material.problem.goal.radius)
    return {}


def _histograms(material: Material, path: Path) -> dict[str, Any]:
    shown = {name: material.errors[name] for name in material.pair}
    trajectory_figures.error_histograms_figure(path, shown, material.problem.goal.radius)
    return {}


def _plane_samples(material: Material, path: Path) -> dict[str, Any]:
    trajectory_figures.samples_figure(path, material.training, material.clusters)
    return {"sizes": material.clusters.sizes}


def _histories(material: Material, path: Path) -> dict[str, Any]:
    trajectory_figures.histories_figure(path, material.training, material.clusters)
    return {}


def _interpolation(material: Material, path: Path) -> dict[str, Any]:
    training, validation, pair = material.training, material.validation, material.pair
    single, mixture = pair.values()
    chosen = trajectory_figures.choose_interpolated(validation, single, mixture, training, NEIGHBOURS)
    p = validation.parameters[chosen]
    around = NearestPlanner(training).neighbours(p, NEIGHBOURS)[0]
    plans = {name: planner(p) for name, planner in pair.items()}
    optimal = validation.trajectory[chosen]
    trajectory_figures.interpolation_figure(path, optimal, training[around], plans, material.problem)
    return {"parameters": p}


def _space_samples(material: Material, path: Path) -> dict[str, Any]:
    space_figures.samples_figure(path, material.training, material.clusters)
    return {"sizes": material.clusters.sizes}


def _violations(material: Material, path: Path) -> dict[str, Any]:
    # A plan that was rejected has no knots, so no figure.
    found = {name: episodes.knot_violation for name, episodes in material.episodes.items()}
    found = {name: values[np.isfinite(values)] for name, values in found.items()}
    space_figures.violations_figure(path, found, "rollouts that enter the sphere")
    return {"mean": {name: float(values.mean()) for name, values in found.items()}}


def _around(material: Material, path: Path) -> dict[str, Any]:
    parameters = benchmark_of(material.problem).figures.around
    assert parameters is not None
    space_figures.around_figure(path, material.training, material.families, parameters)
    return {"parameters": parameters}


def follow(problem: OptimalControlProblem, solver: GuardedSolver, p: Array) -> tuple[Trajectory, Array]:
    """The family of the best solution of p[0] along ``p`` (K, np), and its costs (K,); NaN and +inf where it ends.

    Args:
        problem: the problem.
        solver: starts each problem from the solution before.
        p: parameters along a path, close together.
    """
    best = solve(problem, p[0], starts=12)
    plans, costs, guess = [best.trajectory], [best.cost], best.trajectory
    for row in p[1:]:
        found = solver.solve(row[None], guess, np.zeros(1, np.int64))
        plans.append(found.trajectory)
        costs.append(float(found.cost[0]))
        guess = found.trajectory if found.solved[0] else guess
    return Trajectory.concatenate(plans), np.array(costs)


def _flip(material: Material, path: Path) -> dict[str, Any]:
    problem = material.problem
    rise = benchmark_of(problem).figures.rise
    assert rise is not None
    p = flip_parameters(problem, rise.centre, rise.radius, rise.start, *rise.heights, rise.count)
    with GuardedSolver(problem) as solver:
        (rising, up), (falling, down) = (follow(problem, solver, order) for order in (p, p[::-1]))
    back, down = np.arange(len(p))[::-1], down[::-1]
    both = Trajectory.concatenate([rising, falling[back]])
    optimal = both[np.where(up <= down, np.arange(len(p)), len(p) + np.arange(len(p)))]
    plans = {name: planner(p) for name, planner in material.planners.items()}
    space_figures.flip_figure(path, problem, p, optimal, plans)
    violations = {name: plan_violations(problem, p, batch) for name, batch in {"optimal": optimal, **plans}.items()}
    flip = find_flip(optimal)
    return {
        "parameters": p,
        "costs_from_below": [cost if np.isfinite(cost) else None for cost in up],
        "costs_from_above": [cost if np.isfinite(cost) else None for cost in down],
        "flip_between": [p[flip, 2], p[flip + 1, 2]],
        "violations": violations,
    }


_BOX = {
    "jump": Drawing(_jump, "what a single network and a mixture predict at a jump", 1),
    "errors": Drawing(_errors, "error of the predicted end against the error after tracking", 3),
    "clusters": Drawing(_clusters, "clusters over the parameter box", 4),
}
_PLANE = {
    "samples": Drawing(_plane_samples, "optimal trajectories by cluster", 5),
    "interpolation": Drawing(_interpolation, "a state where the single network averages over families", 5),
    "histories": Drawing(_histories, "state histories by cluster", 6),
    "errors": Drawing(_histograms, "predicted and tracked final errors", 7),
}
_SPACE = {
    "samples": Drawing(_space_samples, "optimal trajectories by cluster", 9),
    "errors": Drawing(_histograms, "predicted and tracked final errors"),
}
_AROUND = Drawing(_around, "optimal paths of the problems next to one", 8)
_FLIP = Drawing(_flip, "where the optimum flips from one side to the other", 10)
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
