"""How much multistart and how many warm starts does generation need? Solves, rate and missed optima by setting.

The same random problems are generated with one setting changed at a time. A problem counts as missed where its best
cost is more than 0.1 % above the lowest that any row found; the thorough row is there to find what the others miss.
Databases of the full size have nearer neighbours than these, so they miss less.

    python scripts/benchmark_generation.py --env GroundVehicle-v0     # writes results/benchmark_generation_<env>.json
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import ocp_envs
from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array
from ocp_envs.support.provenance import provenance, write_json

RESULTS = Path(__file__).resolve().parents[1] / "results"
TOLERANCE = 1e-3
#: Seed of the problems; no split has it.
SEED = 404
#: Finds what the other settings miss.
REFERENCE = GenerationSettings(starts=20, neighbours=4, lookaround=16, margin=1.0, cold=3)
CHANGES: tuple[dict[str, float], ...] = (
    {},
    {"starts": 4},
    {"starts": 16},
    {"neighbours": 1},
    {"neighbours": 3},
    {"lookaround": 4},
    {"lookaround": 16},
    {"margin": 0.03},
    {"margin": 0.1},
    {"margin": 1.0},
    {"cold": 1},
    {"neighbours": 1, "margin": 0.1},
    {"neighbours": 1, "lookaround": 16, "margin": 0.1},
)


def rows() -> dict[str, GenerationSettings]:
    """Settings by name: the thorough ones, the default, and the default with something changed."""
    named = {"thorough": REFERENCE}
    for change in CHANGES:
        name = ", ".join(f"{key} {value:g}" for key, value in change.items()) or "default"
        named[name] = dataclasses.replace(DEFAULT_GENERATION, **change)  # type: ignore[arg-type]
    return named


def measure(problem: OptimalControlProblem, p: Array, settings: GenerationSettings) -> tuple[Array, dict[str, Any]]:
    """Best cost of every problem, and what finding it took."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        database = ocp_envs.generate(problem, Path(folder) / "rows.zarr", p, settings=settings)
        seconds = time.perf_counter() - began
        totals = database.totals()
        record = {"settings": database.settings, "seconds": seconds, "problems_per_second": len(p) / seconds}
        record |= totals | {"solves_per_problem": totals["solves"] / len(p)}
        return database.costs().min(axis=1), record


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--size", type=int, default=3000, help="problems of every row")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    arguments = parser.parse_args()

    problem = ocp_envs.load(arguments.env)
    p = ocp_envs.sample(problem, SEED, arguments.size)
    costs, table = {}, {}
    for name, settings in rows().items():
        costs[name], table[name] = measure(problem, p, settings)
        print(f"{name}: {table[name]['problems_per_second']:.1f} problems per second", flush=True)
    best = np.min(list(costs.values()), axis=0)
    print(f"\n{'':40s} {'solves':>7s} {'ratio':>6s} {'missed':>7s}")
    for name, record in table.items():
        record["missed"] = int((costs[name] > best * (1 + TOLERANCE)).sum())
        record["rate_to_default"] = record["problems_per_second"] / table["default"]["problems_per_second"]
        print(f"{name:40s} {record['solves_per_problem']:7.1f} {record['rate_to_default']:6.2f} {record['missed']:7d}")
    record = {"problem": problem.id, "problems": len(p), "seed": SEED, "tolerance": TOLERANCE, "rows": table}
    write_json(arguments.results / f"benchmark_generation_{problem.id}.json", record | {"provenance": provenance()})


if __name__ == "__main__":
    main()
