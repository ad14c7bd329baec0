"""Make datasets of optimal episodes in Minari's format: the stored optimal trajectories of every problem, tracked.

Each is loaded again and its actions are simulated again by Minari's own environment. A network learns the quadcopter's
control from datasets alone, by behaviour cloning. Datasets go where
``MINARI_DATASETS_PATH`` says, by default to ``data/minari/``; what was found goes to ``minari.json``.
"""

import os
import shutil
from dataclasses import replace
from pathlib import Path

from moe_policy import store
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.demonstrations import (
    CLONE_COLUMNS,
    DATASET_COLUMNS,
    CloneRow,
    Datasets,
    clone_row,
    dataset_row,
)
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.reports.tables import text_table
from moe_policy.rl.cloning import CloningSettings
from ocp_envs.problems import BENCHMARK
from ocp_envs.support.provenance import provenance

#: Control period of the episodes, seconds.
PERIOD = 0.02
#: The problem whose control is cloned, and from how many episodes.
CLONED, EPISODES = "Quadcopter-v0", 1000


def main() -> None:
    parser = cli.parser(__doc__, env=None, cases="episodes of each problem", default_cases=1000)
    arguments = parser.parse()
    cli.need("minari")
    cli.need("h5py")
    folder = Path(os.environ.setdefault("MINARI_DATASETS_PATH", str(cli.DATA / "minari")))
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for problem in BENCHMARK:
        stored = store.shipped_nearest(problem)
        if stored is None:
            continue
        shutil.rmtree(folder / "ocp" / problem.id.rpartition("-v")[0], ignore_errors=True)  # of an earlier run
        rows.append(dataset_row(problem, stored, arguments.cases, PERIOD))
        cli.say(f"{rows[-1].dataset}: {rows[-1].episodes} episodes, {rows[-1].steps:,} control steps")
    clones = [_clone(disturbed) for disturbed in (False, True)]
    record = Datasets(dt=PERIOD, rows=tuple(rows), clones=tuple(clones), provenance=provenance())
    cli.publish(arguments, "minari", record)
    cli.say(f"\n{text_table(rows, DATASET_COLUMNS)}\n{text_table(clones, CLONE_COLUMNS)}")


def _clone(disturbed: bool) -> CloneRow:
    """A clone of the tracked optimum from a dataset of episodes that are ``disturbed``, or not."""
    stored = store.load(CLONED, "nearest", kind=NearestPlanner)
    settings = benchmark_of(stored.problem).learners.settings["bc"]
    assert isinstance(settings, CloningSettings)
    settings = settings if disturbed else replace(settings, disturbance=0.0)
    row = clone_row(stored.problem, stored, settings, EPISODES, PERIOD)
    cli.say(f"{row.dataset}: {row.decisions:,} decisions, the clone succeeds from {row.metrics.success}")
    return row


if __name__ == "__main__":
    cli.run(main)
