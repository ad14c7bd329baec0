"""What the figures of a problem are drawn from: samples, trained networks, and what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from moe_policy.experiments import comparison
from moe_policy.experiments.methods import Method
from moe_policy.learning.clustering import Labels, cluster
from moe_policy.planners.network import NetworkPlanner
from moe_policy.rollouts.episodes import Episodes
from ocp_envs.data.samples import Samples
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array


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
