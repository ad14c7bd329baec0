"""Choose the number k of k-means clusters: mixtures with several k, on the development set.

Each mixture is trained on a part of the training set, with several seeds. Needs the databases ``training`` (as far as
that part) and ``development`` of ``scripts/generate_data.py``. Runs are spread over the cores, and their results are
kept under ``data/choose_clusters/``: an interrupted command continues where it stopped. Writes ``clusters_<env>.json``;
the k of the other experiments stands in ``moe_policy/experiments/benchmark/``.

    python scripts/choose_clusters.py --env GroundVehicle-v0
"""

import dataclasses
import time

from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.cluster_choice import CLUSTER_COLUMNS, ClusterChoice, ClusterRow, chosen, noted
from moe_policy.experiments.cluster_models import execute_all
from moe_policy.experiments.trainings import Folders
from moe_policy.reports.tables import text_table
from ocp_envs.support.provenance import provenance


def main() -> None:
    parser = cli.parser(__doc__, data=True, workers=True, cases="development instances")
    parser.add_argument("--seeds", metavar="N", type=cli.positive, default=3, help="training seeds of every k")
    arguments = parser.parse()
    cli.threads()
    began, problem = time.perf_counter(), arguments.problem
    clusters = benchmark_of(problem).clusters
    if clusters is None:
        parser.error(f"no numbers of clusters are declared for {problem.id}")
    folders = Folders(arguments.data / problem.id, arguments.data / "choose_clusters" / problem.id)
    training, _ = (cli.database(arguments, name) for name in ("training", "development"))
    development = folders.samples(problem, "development")
    cli.at_most(arguments.cases, len(development), "solved development instances")
    development = development[: arguments.cases]
    models = execute_all(problem, clusters, arguments.seeds, folders, development, arguments.workers)
    rows = [ClusterRow.of(found) for found in models]
    k, interval = chosen(rows, len(development))
    record = ClusterChoice(
        env_id=problem.id,
        split="development",
        cases=len(development),
        samples=clusters.instances,
        chosen=k,
        used=clusters.used,
        interval=interval,
        rows=noted(rows, k, clusters.used),
        settings=dataclasses.asdict(clusters.settings),
        training_key=training.key,
        seconds=time.perf_counter() - began,
        provenance=provenance(),
    )
    cli.publish(arguments, f"clusters_{problem.id}", record)
    print(text_table(record.rows, CLUSTER_COLUMNS))


if __name__ == "__main__":
    cli.run(main, continues=True)
