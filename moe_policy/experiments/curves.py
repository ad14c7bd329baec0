"""Training curves over seeds, and intervals over seeds.

Curves come from the records of scripts/train_rl.py, one a seed. Over n seeds the median is given with the least and the
most as its interval. By order statistics these enclose the median of all seeds with probability 1 − 2^(1 − n), whatever
the distribution: 75 % for three seeds, 94 % for five. (A bootstrap of so few values resamples little else, and claims
95 %.) Single figures also get the mean with Student's interval at 95 %, n ≥ 2.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from moe_policy.rl.settings import ALGORITHMS, RLSettings
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

Record = dict[str, Any]


# -- over seeds --------------------------------------------------------------------------------------------------------


def over_seeds(curves: Sequence[Mapping[str, Any]], axis: str, figure: str) -> tuple[Array, Array]:
    """The curves of all seeds on common points: (points (G,), values (S, G)).

    Between evaluations curves are interpolated linearly; behind its last one a training has ended and keeps its
    figure. The points are those of the seed with the most evaluations, from where all have begun. A seed has NaN where
    its evaluations have no figure, and seeds without any are left out.

    Args:
        curves: with lists of equal length under ``axis`` and ``figure``, ``None`` where there is none; of
            :func:`curve_of`.
        axis: ``"steps"`` or ``"seconds"``.
        figure: such as ``"success"``.
    """
    sides = [(np.array(c[axis], float), np.array(c[figure], float)) for c in curves]  # None becomes NaN
    sides = [(at, values) for at, values in sides if np.isfinite(values).any()]
    if not sides:
        return np.empty(0), np.empty((0, 0))
    begun = max(at[0] for at, _ in sides)
    points = np.unique(np.concatenate([at for at, _ in sides if len(at) == max(len(a) for a, _ in sides)]))
    last = max(at[-1] for at, _ in sides)
    points = np.append(points[(points >= begun) & (points < last)], last)
    return points, np.array([np.interp(points, at, values) for at, values in sides])


def band(values: ArrayLike) -> Array:
    """Least, median and most over the seeds that have a figure at each of G points: values (S, G) → (3, G)."""
    table = np.asarray(values, dtype=np.float64)
    result = np.full((3, table.shape[1]), np.nan)
    for i, column in enumerate(table.T):
        known = column[np.isfinite(column)]
        if len(known):
            result[:, i] = known.min(), np.median(known), known.max()
    return result


# -- learners ----------------------------------------------------------------------------------------------------------

#: Figures of an evaluation that are followed over the training, as shares of the episodes where they are counts.
FOLLOWED = ("success", "cost_ratio", "mean_return", "violation")


def curve_of(run: Mapping[str, Any]) -> Record:
    """The curve of a record of scripts/train_rl.py: lists over evaluations, ``None`` for what was not kept."""
    curve, count = run["curve"], run["development"]["count"]
    followed = {key: [point.get(key) for point in curve] for key in FOLLOWED}
    followed["success"] = [point["success"] / count for point in curve]
    axes = {axis: [point[axis] for point in curve] for axis in ("steps", "seconds")}
    return {"seed": run["settings"]["seed"], **axes, **followed}


def learner_runs(folder: Path, problem: OptimalControlProblem) -> dict[str, list[Record]]:
    """The complete training records of every learner of ``problem`` in ``folder``, by algorithm and in order of seeds.

    Raises:
        ValueError: seeds of one algorithm were trained with different settings.
    """
    pattern = re.compile(rf"training_([a-z0-9]+)_{re.escape(problem.id)}(_seed\d+)?\.json")
    found: dict[str, dict[int, Record]] = {}
    settings: dict[str, RLSettings] = {}
    for path in sorted(folder.glob(f"training_*_{problem.id}*.json")):
        match = pattern.fullmatch(path.name)
        if match is None:
            continue
        run, algorithm = json.loads(path.read_text()), match[1]
        given = ALGORITHMS[algorithm](**run["settings"])
        same = dataclasses.replace(given, seed=0)
        if settings.setdefault(algorithm, same) != same:
            raise ValueError(
                f"{path.name} has other settings than the seeds before it: {_differences(settings[algorithm], same)}; "
                "train all seeds with the same ones, or move this record elsewhere"
            )
        found.setdefault(algorithm, {})[given.seed] = run
    return {name: [runs[seed] for seed in sorted(runs)] for name, runs in sorted(found.items())}


def _differences(one: RLSettings, other: RLSettings) -> str:
    pairs = ((f.name, getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    return ", ".join(f"{name} {a} and {b}" for name, a, b in pairs if a != b)


def learner_record(runs: Sequence[Mapping[str, Any]]) -> Record:
    """What the seeds of one learner spent and got, as JSON."""
    settings = {key: value for key, value in runs[0]["settings"].items() if key != "seed"}
    judged = [run["validation"]["success"] for run in runs if run.get("validation")]
    shares = tuple(share["fraction"] for share in judged)
    return {
        "settings": settings,
        "seeds": [run["settings"]["seed"] for run in runs],
        "steps": [run["steps"] for run in runs],
        "simulated_seconds": [run["steps"] * settings["period"] for run in runs],
        "seconds": [run["seconds"] for run in runs],
        "trials_before": len(runs[0].get("search", [])),
        "steps_of_trials": sum(trial["steps"] for trial in runs[0].get("search", [])),
        "validation_success": Spread.of(shares, (0, 1)).to_json() if shares else None,
        "curves": [curve_of(run) for run in runs],
    }
