"""What the databases of a problem hold and how good they are, as text, as JSON and as a figure.

Every stored trajectory is checked again, and a random subset of the best plans is integrated with SciPy's DOP853.
Writes ``data_<env>.json`` and ``.png``.

    python scripts/report_data.py
    python scripts/report_data.py --env GroundVehicle-v0 --splits training validation
"""

from moe_policy.experiments import cli
from moe_policy.experiments.data import accuracy_of, contents
from moe_policy.experiments.data_report import DataReport, Integration, text
from moe_policy.experiments.figures.data import data_figure
from ocp_envs.sets.splits import sets_of
from ocp_envs.solvers.accuracy import ATOL, RTOL
from ocp_envs.support.provenance import provenance

#: Seed of the choice of the plans that are integrated.
SEED = 505


def main() -> None:
    parser = cli.parser(__doc__, data=True)
    parser.add_argument("--splits", nargs="+", help="names of the sets; by default all whose database exists")
    parser.add_argument("--accuracy-cases", type=cli.positive, default=300, help="plans of each set to integrate")
    arguments = parser.parse()

    problem, folder = arguments.problem, arguments.data / arguments.problem.id
    sets = sets_of(problem)
    with cli.option("--splits"):
        names = [name for name in arguments.splits or sets.splits if sets.split(name)]
    if arguments.splits is None:  # those that exist, or else a complaint about the first
        names = [name for name in names if (folder / f"{name}.zarr").exists()] or names[:1]
    reports, splits = {}, {}
    for name in names:
        database = cli.database(arguments, name)
        accuracy = accuracy_of(database, arguments.accuracy_cases, SEED)
        held = contents(database, accuracy)
        reports[name], splits[name] = (held, accuracy), held.report
    cli.say(text(f"{problem.id}: {problem.title}", splits))
    integration = Integration(method="DOP853", rtol=RTOL, atol=ATOL, seed=SEED)
    record = DataReport(env_id=problem.id, splits=splits, integration=integration, provenance=provenance())
    path = cli.publish(arguments, f"data_{problem.id}", record)
    cli.say(f"wrote {data_figure(path.with_suffix('.png'), reports)}")


if __name__ == "__main__":
    cli.run(main)
