"""Compare optimal control, networks, mixtures, reinforcement learning and the bare stabiliser on hard problems.

All run from the same starts through the same rollout loop: those of ``uniform`` (the validation set), ``boundary``
(next to the jump of the optimum) and ``outside`` (beyond the parameter box), as far as the problem has them;
``scripts/make_splits.py`` makes the last two. The table goes to the terminal; with all figures, and the curves over the
distance from the jump, to ``results/compare_splits_<env>.json``, and the picture to ``results/splits_<env>.png``. The
pendulum takes about two minutes.

    python scripts/compare_splits.py --env GroundVehicle-v0
    python scripts/compare_splits.py --cases 100 --results /tmp
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

import ocp_envs
from moe_policy.experiments.comparison import run
from moe_policy.experiments.figures.splits import splits_figure
from moe_policy.experiments.methods import Method, shipped, solve_all, stabiliser
from moe_policy.experiments.splits import BINNED, SPLIT_COLUMNS, SPLITS, curves, judged, separations
from moe_policy.experiments.tables import text_table
from moe_policy.planners.stored import StoredPlans
from moe_policy.rollouts.episodes import Episodes
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.sets.discontinuity import discontinuity_of
from ocp_envs.sets.splits import sets_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]


def log(text: str) -> None:
    print(text, flush=True)


def compare(
    problem: OptimalControlProblem, methods: list[Method], split: str, cases: reference.ReferenceSet
) -> tuple[dict[str, Any], dict[str, dict[str, Any]], dict[str, Episodes]]:
    """All methods on one split: what was compared, and by method the row and the episodes."""
    trajectories, found = solve_all(problem, cases.parameters, keep=ROOT / "data" / "optimal" / problem.id)
    solved = np.isfinite(found)
    gap = found[solved] / cases.cost[solved] - 1
    about = {
        "cases": len(cases),
        "optimal_solved": int(solved.sum()),
        "reference_gap": {
            "within_0.1_percent": int((np.abs(gap) < 1e-3).sum()),
            "largest": float(gap.max(initial=0.0)),
            "smallest": float(gap.min(initial=0.0)),
        },
    }
    # What was solved is followed, not solved again.
    optimal = Method("optimal", StoredPlans(cases.parameters, trajectories))
    rows: dict[str, dict[str, Any]] = {}
    episodes: dict[str, Episodes] = {}
    for method in [optimal, *methods]:
        row, made = run(problem, method, cases.parameters, baseline=episodes.get("optimal"), batches=())
        rows[method.name], episodes[method.name] = row.to_json() | {"judged": judged(problem, made)}, made
        log(f"{split}, {method.name}: {row.metrics.success.count} of {len(cases)}")
    return about, rows, episodes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--cases", type=int, help="problems of every split; all by default")
    parser.add_argument("--splits", nargs="+", choices=SPLITS, default=list(SPLITS), help="which; all by default")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the results")
    arguments = parser.parse_args()

    torch.set_num_threads(1)  # the networks are far too small for more
    began = time.perf_counter()
    problem = ocp_envs.load(arguments.env)
    methods = [*shipped(problem, ROOT / "results"), *stabiliser(problem)]
    there = {"validation", *sets_of(problem).hard}
    chosen = {split: SPLITS[split] for split in arguments.splits if SPLITS[split] in there}
    if not chosen:
        parser.error(f"{problem.id} has no such split; there are {', '.join(s for s in SPLITS if SPLITS[s] in there)}")
    splits: dict[str, dict[str, Any]] = {}
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    distances: list[Array] = []
    episodes: list[dict[str, Episodes]] = []
    discontinuity = discontinuity_of(problem)
    for split, name in chosen.items():
        cases = reference.load(problem, name)[: arguments.cases]
        splits[split], rows[split], made = compare(problem, methods, split, cases)
        if split in BINNED and discontinuity is not None:
            distances.append(discontinuity.distance(problem, cases.parameters, cases.mode_costs))
            episodes.append(made)

    names = ["optimal", *(method.name for method in methods)]
    joined = {name: Episodes.concatenate([made[name] for made in episodes]) for name in names} if episodes else {}
    table = [{"name": name, **{split: rows[split][name] for split in rows}} for name in names]
    record = {
        "env_id": problem.id,
        "splits": {
            split: about | {"separations": separations(problem, rows[split])} for split, about in splits.items()
        },
        "rows": table,
        "curves": curves(problem, np.concatenate(distances), joined) if "boundary" in rows else None,
        "seconds": time.perf_counter() - began,
        "provenance": provenance(),
    }
    write_json(arguments.results / f"compare_splits_{problem.id}.json", record)
    figure = splits_figure(arguments.results / f"splits_{problem.id}.png", problem, record)
    log(f"\n{text_table(table, SPLIT_COLUMNS)}")
    log(f"{record['seconds']:.0f} s; written to {arguments.results / f'compare_splits_{problem.id}.json'} and {figure}")


if __name__ == "__main__":
    main()
