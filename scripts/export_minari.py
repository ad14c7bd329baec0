"""Make datasets of optimal episodes in Minari's format: the stored optimal trajectories of every problem, tracked.

Each is loaded again and its actions are simulated again by Minari's own environment. Datasets go where
``MINARI_DATASETS_PATH`` says, by default to ``data/minari/``; what was found goes to ``minari.json``.
"""

import os
import shutil
from pathlib import Path

from moe_policy import store
from moe_policy.experiments import cli
from moe_policy.experiments.demonstrations import DATASET_COLUMNS, Datasets, dataset_row
from moe_policy.reports.tables import text_table
from ocp_envs.problems import BENCHMARK
from ocp_envs.support.provenance import provenance

#: Control period of the episodes, seconds.
PERIOD = 0.02


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
    cli.publish(arguments, "minari", Datasets(dt=PERIOD, rows=tuple(rows), provenance=provenance()))
    cli.say(f"\n{text_table(rows, DATASET_COLUMNS)}")


if __name__ == "__main__":
    cli.run(main)
