"""Partition of samples by the solution family of their optimal trajectory (Tang & Hauser, section III-D).

Solutions are clustered, not parameters: the map from parameters to solutions is what has discontinuities.

- ``custom``: the problem's own solution families (final winding, direction of travel, side of the obstacle).
- ``kmeans``: k-means on flat trajectories, every component standardised.
- ``kmeans-pca``: the same after a projection on the principal components of the standardised trajectories.
- ``reaction``: k-means on the directions in which the path constraints push the optimum
  (:mod:`moe_policy.learning.reactions`).
- ``continuation``: families that are found: neighbours whose optima lead to each other belong together
  (:mod:`moe_policy.learning.families`). Where a random part of the samples is one family, all are.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from sklearn.cluster import KMeans
from sklearn.decomposition import PCA

from moe_policy.learning.families import NEIGHBOURS, families_of, record
from moe_policy.learning.reactions import reactions
from moe_policy.planners.scaling import Standardizer, blocks
from ocp_envs.data.continuation import continued
from ocp_envs.data.database import Database
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.support.arrays import Bools, Ints, frozen_array
from ocp_envs.support.checks import check_kind, check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.suggestions import did_you_mean

METHODS = ("custom", "kmeans", "kmeans-pca", "reaction", "continuation")
#: Where so many random samples are one family, continuation does not compare the others.
SCOUTS = 1_000
#: k-means fits its centres to at most this many random samples; the others join the nearest centre.
FITTED = 150_000


@dataclass(frozen=True, eq=False)
class Labels:
    """A partition of M samples into k clusters.

    Args:
        values: cluster of every sample, (M,) integers in 0 … k−1, none empty.
        names: k names, one for each cluster.
        method: how it was made, one of :data:`METHODS` or a name chosen by the user.
        settings: arguments of the method, for the record.
        strays: samples whose trajectory is none of their cluster's, (M,), such as those of solution families too small
            for an expert: no expert learns them, the gate does. None by default.
    """

    values: Ints
    names: tuple[str, ...]
    method: str
    settings: Mapping[str, object] = field(default_factory=dict)
    strays: Bools = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        check_kind("method", self.method, str)
        check_kind("settings", self.settings, Mapping)
        check_kind("values", self.values, (np.ndarray, list, tuple), "give the cluster of each sample")
        if not isinstance(self.values, np.ndarray):
            for value in self.values:
                check_whole("each of values", value, 0)
        values = np.array(self.values)
        if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
            raise ValueError(f"labels must be a vector of integers, got {values.dtype} of shape {values.shape}")
        check_kind("names", self.names, (tuple, list), "give a name for each cluster")
        for name in self.names:
            check_kind("each of names", name, str)
        if not len(self.names):
            raise ValueError(f"labels must have a name for each cluster, at least one; got names {self.names!r}")
        if (used := np.unique(values).tolist()) != list(range(self.k)):
            raise ValueError(f"labels must use each of 0 … {self.k - 1}, one a name; got {used}")
        strays = np.asarray(self.strays) if np.size(self.strays) else np.zeros(len(values), bool)
        if strays.shape != values.shape or strays.dtype != bool:
            raise ValueError(f"strays: expected truth values {values.shape}, got {strays.dtype} {strays.shape}")
        object.__setattr__(self, "values", frozen_array(values, np.int64))
        object.__setattr__(self, "strays", frozen_array(strays, bool))
        object.__setattr__(self, "settings", MappingProxyType(dict(self.settings)))

    def __len__(self) -> int:
        return len(self.values)

    @property
    def k(self) -> int:
        """Number of clusters."""
        return len(self.names)

    @property
    def families(self) -> Ints:
        """Cluster of the trajectory of every sample, (M,): −1 for strays."""
        return np.where(self.strays, -1, self.values)

    @property
    def sizes(self) -> Ints:
        """Number of samples of every cluster, (k,)."""
        return np.bincount(self.values, minlength=self.k)


@checked
def cluster(
    database: Samples | SampleSource,
    method: str,
    *,
    k: int | None = None,
    components: int | None = None,
    seed: int = 0,
    n_init: int = 10,
    kept: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
) -> Labels:
    """Partition the samples of ``database``.

    Args:
        database: a Database or its samples, M of them.
        method: ``"custom"``, ``"kmeans"``, ``"kmeans-pca"``, ``"reaction"`` or ``"continuation"``.
        k: number of clusters, for k-means and ``reaction``; ``custom`` has those of the problem's solution families
            that occur, and ``continuation`` those that it finds, or these split further into k parts.
        components: number of principal components, for ``kmeans-pca`` alone.
        seed: of the initial centres of k-means.
        n_init: number of runs of k-means, the best of which is kept.
        kept: folder in which ``continuation`` keeps its solves, so that an interrupted call continues and later ones
            have them; by default one beside a Database, and none for samples.
        executor: solves for ``continuation``, as in :func:`ocp_envs.generate`; by default a pool of processes.

    Raises:
        DatabaseError: what ``continuation`` kept is damaged.
        TypeError: a number that is not whole.
        ValueError: an unknown method, numbers that it does not take or that are out of range, or unusable samples.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; {did_you_mean(method, METHODS)}known are {list(METHODS)}")
    if (method != "kmeans-pca") != (components is None):
        raise ValueError(f"'components' is needed by 'kmeans-pca' and by nothing else; got {method!r} and {components}")
    if method != "continuation" and (method == "custom") != (k is None):
        raise ValueError(f"'k' is needed by k-means and not by 'custom'; got method {method!r} and k = {k}")
    check_whole("n_init", n_init)
    samples = samples_of(database)
    if method == "continuation":
        beside = database.path.with_suffix(".continuation") if isinstance(database, Database) else None
        return _by_continuation(samples, beside if kept is None else Path(kept), executor, k)
    if k is None:
        return _by_mode(samples)
    if method == "reaction":
        return _by_reaction(samples, k, seed, n_init)
    return _by_kmeans(samples, method, k, components, seed, n_init)


def _by_mode(samples: Samples) -> Labels:
    present, values = np.unique(samples.mode, return_inverse=True)
    names = samples.problem.modes.names
    if present[0] < 0 or present[-1] >= len(names):
        raise ValueError(f"modes must lie in 0 … {len(names) - 1}, got {present.tolist()}")
    return Labels(values, tuple(names[mode] for mode in present), "custom", {"modes": present.tolist()})


def _by_continuation(samples: Samples, kept: Path | None, executor: Executor | None, k: int | None) -> Labels:
    if k is not None:
        check_whole("k", k, 1, len(samples))
    elif len(samples) > SCOUTS and (alone := _one_family(samples, kept, executor)) is not None:
        return alone
    found = continued(samples, kept, neighbours=NEIGHBOURS, executor=executor)
    parts = families_of(samples, found, least=k or 1)
    if k is not None and (count := int(parts.values.max()) + 1) > k:
        raise ValueError(f"k: got {k}, but {count} families were found; expected at least {count}, or None for these")
    names = tuple(f"family {i}" for i in range(parts.values.max() + 1))
    return Labels(parts.values, names, "continuation", record(found, parts), parts.moved)


def _one_family(samples: Samples, kept: Path | None, executor: Executor | None) -> Labels | None:
    """All ``samples`` in one family, if :data:`SCOUTS` random ones are one; else ``None``."""
    scouts = samples[np.sort(np.random.default_rng(0).permutation(len(samples))[:SCOUTS])]
    found = continued(scouts, kept, neighbours=NEIGHBOURS, executor=executor)
    parts = families_of(scouts, found)
    if parts.values.any():
        return None
    values = np.zeros(len(samples), dtype=np.int64)
    return Labels(values, ("family 0",), "continuation", record(found, parts) | {"scouts": SCOUTS})


def _by_reaction(samples: Samples, k: int, seed: int, n_init: int) -> Labels:
    check_whole("k", k, 1, len(samples))
    fitted = KMeans(n_clusters=k, n_init=n_init, random_state=seed).fit(reactions(samples))
    present, values = np.unique(fitted.labels_, return_inverse=True)
    names = tuple(f"side {i}" for i in range(len(present)))
    settings = {"k": k, "seed": seed, "n_init": n_init, "inertia": float(fitted.inertia_)}
    return Labels(values, names, "reaction", settings)


def _by_kmeans(samples: Samples, method: str, k: int, components: int | None, seed: int, n_init: int) -> Labels:
    trajectory, count = samples.trajectory, len(samples.parameters)
    check_whole("k", k, 1, count)
    fitted_on = np.arange(count)
    if count > FITTED:
        fitted_on = np.sort(np.random.default_rng(seed).permutation(count)[:FITTED])
    flat = trajectory[fitted_on].flat()
    scaler = Standardizer.fit(flat)
    features = scaler.scale(flat)
    settings: dict[str, object] = {"k": k, "seed": seed, "n_init": n_init}
    projection: PCA | None = None
    if components is not None:
        check_whole("components", components, 1, min(features.shape))
        projection = PCA(n_components=components, svd_solver="full").fit(features)
        features = projection.transform(features)
        settings |= {"components": components, "explained": float(projection.explained_variance_ratio_.sum())}
    fitted = KMeans(n_clusters=k, n_init=n_init, random_state=seed).fit(features)
    labels = fitted.labels_
    if count > FITTED:

        def nearest(rows: slice) -> Ints:
            values = scaler.scale(trajectory[rows].flat())
            return np.asarray(fitted.predict(values if projection is None else projection.transform(values)))

        labels = np.concatenate([nearest(rows) for rows in blocks(count)])
        settings["fitted_on"] = FITTED
    # Identical trajectories can leave fewer clusters than asked for.
    present, values = np.unique(labels, return_inverse=True)
    settings["inertia"] = float(fitted.inertia_)
    return Labels(values, tuple(f"cluster {i}" for i in range(len(present))), method, settings)


def without_small(samples: Samples, labels: Labels, least: int) -> Labels:
    """The ``labels`` of ``samples`` without clusters of fewer than ``least``: an expert learns nothing from a few.

    Their samples join the remaining cluster whose mean trajectory is nearest, every component standardised. The
    largest cluster always remains.
    """
    sizes = labels.sizes
    kept = np.flatnonzero((sizes >= least) | (np.arange(labels.k) == sizes.argmax()))
    moved = np.flatnonzero(~np.isin(labels.values, kept))
    if not len(moved):
        return labels
    flat = samples.trajectory.flat()
    scaled = Standardizer.fit(flat).scale(flat)
    centres = np.array([scaled[labels.values == cluster].mean(axis=0) for cluster in kept])
    values = np.searchsorted(kept, labels.values)
    values[moved] = np.linalg.norm(scaled[moved, None] - centres, axis=2).argmin(axis=1)
    names = tuple(labels.names[cluster] for cluster in kept)
    return Labels(values, names, labels.method, {**labels.settings, "least": least})
