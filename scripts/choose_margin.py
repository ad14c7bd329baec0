"""Choose a margin on the obstacle: networks are asked for larger spheres, on the development set.

Each network plans for spheres that are larger by each of several margins. Its rollouts are evaluated with the true
spheres: mean violation at the knots and on the whole path, and cost relative to the tracked optimum. Writes
``margin_<env>.json`` and ``.png``; the margin of the comparison's extra rows, ``planners.margin`` of the benchmark, is
chosen from them.

    python scripts/choose_margin.py
"""

import moe_policy
from moe_policy.experiments import cli
from moe_policy.experiments.benchmark import benchmark_of
from moe_policy.experiments.comparison import COLUMNS, MarginRow, Margins, run, track_optimum
from moe_policy.experiments.figures.comparison import margins_figure
from moe_policy.experiments.methods import shipped
from moe_policy.planners.margin import WithMargin
from moe_policy.reports.tables import Column, text_table
from moe_policy.score.method import Method
from ocp_envs.sets import reference
from ocp_envs.support.progress import track
from ocp_envs.support.provenance import provenance

MARGINS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)
MARGIN_COLUMNS: tuple[Column[MarginRow], ...] = (
    Column("margin", lambda row: row.margin, "g"),
    *(column.of_part(lambda row: row.row) for column in COLUMNS),
)


def main() -> None:
    parser = cli.parser(__doc__, env="QuadcopterObstacle-v0", data=True, cases="development instances")
    parser.add_argument("--parameter", metavar="NAME", default="radius", help="what is enlarged; radius by default")
    arguments = parser.parse()
    cli.threads()
    problem, parameter = arguments.problem, arguments.parameter
    if parameter not in problem.parameters.names:
        parser.error(f"argument --parameter: got {parameter!r}; {problem.id} has {', '.join(problem.parameters.names)}")
    known = reference.load(problem, "development")
    cli.at_most(arguments.cases, len(known), "development instances")
    cases = known[: arguments.cases]
    keep = arguments.data / "optimal" / problem.id
    optimum = track_optimum(problem, cases.parameters, cases.cost, shipped(problem), keep)
    rows = [MarginRow(margin=None, row=optimum.row)]
    planners = [moe_policy.load_planner(problem, name) for name in benchmark_of(problem).planners.compared]
    runs = [(planner, margin) for planner in planners for margin in MARGINS]
    for planner, margin in track(runs, len(runs), unit="run", label="margins"):
        method = Method(planner.name, WithMargin(problem, planner, parameter, margin))
        row, _ = run(problem, method, cases.parameters, baseline=optimum.baseline, batches=())
        rows.append(MarginRow(margin=margin, row=row))
    record = Margins(
        env_id=problem.id,
        split="development",
        parameter=parameter,
        cases=len(cases),
        rows=tuple(rows),
        provenance=provenance(),
    )
    margins_figure(cli.publish(arguments, f"margin_{problem.id}", record).with_suffix(".png"), rows)
    print(text_table(rows, MARGIN_COLUMNS))


if __name__ == "__main__":
    cli.run(main)
