"""How each named planner is trained."""

from __future__ import annotations

import re
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from types import MappingProxyType
from typing import TypedDict

from moe_policy.learning.clustering import cluster
from moe_policy.learning.joint import fit_mixture_jointly, retrain
from moe_policy.learning.settings import DEFAULT, TrainingSettings
from moe_policy.learning.training import fit_mixture, fit_single
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import ARGMAX, Mixing, Softmax
from ocp_envs.data.beyond import beyond
from ocp_envs.data.samples import Samples, SampleSource, samples_of

PRINCIPAL_COMPONENTS = 5
#: Number of sides of the path constraints into which one family is split, and fraction of the epochs in which its
#: experts are one network.
SIDES, TOGETHER = 8, 0.5
#: The names of planners, and what each is.
FORMS: Mapping[str, str] = MappingProxyType(
    {
        "snn": "one network",
        "moe-custom": "a mixture over the problem's own solution families, trained decoupled",
        "moe-kmeans-<k>": "the same over k-means clusters of the trajectories",
        "moe-kmeans-pca-<k>": f"the same after a projection on {PRINCIPAL_COMPONENTS} principal components",
        "moe-auto": "the same over solution families that continuation finds, whose experts also learn their family "
        f"beyond its border; where it finds one, one network or, with path constraints, moe-reaction-{SIDES}",
        "moe-auto-<k>": "the same over these families, split further into k parts",
        "moe-reaction-<k>": "the same over k sides of the path constraints, with experts that begin as one network, "
        "and learn the images of the samples under a symmetry of the problem, too",
        "moe-random": "a mixture with as many experts as moe-custom, trained jointly from random weights",
        "moe-retrained-argmax": "moe-custom, retrained as one network with argmax",
        "moe-retrained-softmax-<epsilon>": "the same with softmax at epsilon, for instance 1 or 0.1",
        "nearest": "the stored solution of the nearest stored parameter",
    }
)


#: Regular expressions of the names.
_PATTERNS = tuple(re.escape(form).replace("<k>", r"[1-9]\d*").replace("<epsilon>", r"\d+(\.\d+)?") for form in FORMS)


class _Common(TypedDict):
    """Arguments that all trainings take."""

    settings: TrainingSettings
    seed: int
    checkpoints: Path | None


def check(name: str) -> None:
    """Refuse a ``name`` that is none of :data:`FORMS`.

    Raises:
        ValueError: it is none; the message lists them.
    """
    if not any(re.fullmatch(pattern, name) for pattern in _PATTERNS):
        raise ValueError(f"no recipe for {name!r}; expected one of {', '.join(FORMS)}")


def make(
    name: str,
    database: Samples | SampleSource,
    *,
    settings: TrainingSettings = DEFAULT,
    seed: int = 0,
    executor: Executor | None = None,
    checkpoints: Path | None = None,
    kept: Path | None = None,
) -> NetworkPlanner | NearestPlanner:
    """Make the planner called ``name`` from a database.

    Args:
        name: one of :data:`FORMS`.
        database: a Database or its samples.
        settings: how networks are trained.
        seed: of clustering and training.
        executor: trains the networks of a mixture in parallel, and solves for continuation; by default they are trained
            one after the other.
        checkpoints: folder of its checkpoints, as in :func:`~moe_policy.fit_single`.
        kept: folder in which continuation keeps its solves, as in :func:`~moe_policy.cluster`.

    Raises:
        CheckpointError: the folder holds the state of another training.
        ValueError: no such recipe, or unusable samples.
    """
    check(name)
    if name == "nearest":
        return NearestPlanner(database)
    how: _Common = {"settings": settings, "seed": seed, "checkpoints": checkpoints}
    if name == "snn":
        return fit_single(database, **how)
    if name == "moe-custom":
        return fit_mixture(database, cluster(database, "custom"), executor=executor, **how)
    if found := re.fullmatch(r"moe-(kmeans|kmeans-pca)-(\d+)", name):
        components = PRINCIPAL_COMPONENTS if found[1] == "kmeans-pca" else None
        labels = cluster(database, found[1], k=int(found[2]), components=components, seed=seed)
        return fit_mixture(database, labels, executor=executor, **how)
    if found := re.fullmatch(r"moe-auto(?:-(\d+))?", name):
        k = None if found[1] is None else int(found[1])
        labels = cluster(database, "continuation", k=k, kept=kept, executor=executor)
        if labels.k == 1 and not samples_of(database).problem.n_clearances:  # nothing to choose from
            return fit_single(database, name=name, **how)
        if labels.k == 1:  # one family, but steep where its optimum swings to another side of a constraint
            return _by_sides(database, SIDES, name, executor, how)
        further = beyond(database, labels.families)
        return fit_mixture(database, labels, executor=executor, name=name, beyond=further, **how)
    if found := re.fullmatch(r"moe-reaction-(\d+)", name):
        return _by_sides(database, int(found[1]), name, executor, how)
    if name == "moe-random":
        return fit_mixture_jointly(database, cluster(database, "custom").k, **how)
    epsilon = name.removeprefix("moe-retrained-").removeprefix("softmax-")
    mixing: Mixing = ARGMAX if epsilon == "argmax" else Softmax(float(epsilon))
    trained = make("moe-custom", database, executor=executor, **how)
    assert isinstance(trained, NetworkPlanner)
    return retrain(trained, database, mixing, **how)


def _by_sides(
    database: Samples | SampleSource, k: int, name: str, executor: Executor | None, how: _Common
) -> NetworkPlanner:
    """A mixture over ``k`` sides of the path constraints, whose experts begin as one network."""
    samples = samples_of(database)
    if samples.problem.symmetry is not None:
        samples = samples.with_images()
    labels = cluster(samples, "reaction", k=k, seed=how["seed"])
    return fit_mixture(samples, labels, executor=executor, together=TOGETHER, name=name, **how)
