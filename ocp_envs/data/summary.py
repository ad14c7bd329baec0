"""What a database holds, in words, and its best solutions as one file."""

from __future__ import annotations

import os

import numpy as np

from ocp_envs.data.database import Database
from ocp_envs.data.layout import MISSING
from ocp_envs.solvers.nlp import Status
from ocp_envs.support.archives import write_arrays
from ocp_envs.support.arrays import Array


def summary(database: Database) -> str:
    """What ``database`` holds: a line for each of its properties."""
    costs, totals = database.costs(), database.totals()
    solved = np.isfinite(costs).any(axis=1)
    families = np.bincount(costs[solved].argmin(axis=1), minlength=costs.shape[1])
    size = sum(file.stat().st_size for file in database.path.rglob("*") if file.is_file())
    box = zip(database.problem.parameters.coordinates, database.parameters.T)
    lines = {
        "problem": f"{database.problem.id}, {database.problem.title}",
        "instances": _instances(database),
        "parameters": ", ".join(f"{c.name} {values.min():.3g} … {values.max():.3g} {c.unit}" for c, values in box),
        "families": ", ".join(
            f"{name}: best of {count:,}" for name, count in zip(database.problem.modes.names, families)
        ),
        "cost": _spread(costs[solved].min(axis=1)),
        "solver": ", ".join(f"{totals[name]:,} {name}" for name in ("solves", "failures", "fallbacks", "iterations")),
        "settings": ", ".join(f"{name} {value}" for name, value in database.settings.items()),
        "size": f"{size / 1e6:.3g} MB in {database.path}",
    }
    return "\n".join(f"{name:<12}{text}" for name, text in lines.items())


def _instances(database: Database) -> str:
    status = database.status
    words = {MISSING: "not solved yet"} | {each: each.name.lower().replace("_", " ") for each in Status}
    counts = {word: int((status == value).sum()) for value, word in words.items()}
    return f"{len(database):,}: " + ", ".join(f"{count:,} {word}" for word, count in counts.items() if count)


def _spread(values: Array) -> str:
    if not len(values):
        return "none known"
    low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
    return f"{low:.4g} … {high:.4g}, median {middle:.4g}"


def export_arrays(database: Database, path: str | os.PathLike[str]) -> None:
    """Write the best solutions of ``database`` to the archive ``path`` (.npz): arrays by name, a row for each instance.

    These are ``parameters`` (M, np), ``states`` (M, N, nx), ``controls`` (M, N − 1, nu), ``duration`` (M,), ``cost``
    (M,), ``mode`` (M,), the family, and ``index`` (M,), the position among all instances of the database.
    """
    samples = database.samples()
    write_arrays(
        path,
        {
            "parameters": samples.parameters,
            "states": samples.trajectory.states,
            "controls": samples.trajectory.controls,
            "duration": samples.trajectory.duration,
            "cost": samples.cost,
            "mode": samples.mode,
            "index": samples.index,
        },
    )
