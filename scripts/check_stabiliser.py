"""The regulator at the goal without a plan, inside the operating box and without it.

An episode that leaves the operating box fails. Here the plant is regulated from the same initial conditions once in
the declared box and once in a box of ten times its width, which tells failures of the regulator from those of the box.
Costs are relative to the tracked optimum. Writes ``stabiliser_<env>.json``.

    python scripts/check_stabiliser.py
"""

import dataclasses

from moe_policy.control.stabiliser import Stabiliser
from moe_policy.experiments import cli
from moe_policy.experiments.comparison import COLUMNS, Sensitivity, run, track_optimum
from moe_policy.experiments.methods import shipped
from moe_policy.reports.tables import text_table
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.provenance import provenance
from ocp_envs.system import Box

#: Width of the wide box, in widths of the operating box.
WIDER = 10.0


def widened(problem: OptimalControlProblem) -> OptimalControlProblem:
    """``problem`` with an operating box that is :data:`WIDER` times as wide."""
    box = problem.system.state
    reach = WIDER * box.width / 2
    coordinates = (
        dataclasses.replace(coordinate, lower=float(centre - r), upper=float(centre + r))
        for coordinate, centre, r in zip(box.coordinates, box.centre, reach, strict=True)
    )
    system = dataclasses.replace(problem.system, state=Box(tuple(coordinates)))
    return dataclasses.replace(problem, id=problem.id.replace("-v", "Wide-v"), system=system)


def main() -> None:
    parser = cli.parser(__doc__, env="Quadcopter-v0", cases="validation instances")
    arguments = parser.parse()
    cli.threads()
    problem = arguments.problem
    if not problem.hold:
        parser.error(f"the goal of {problem.id} cannot be regulated")
    known = reference.load(problem, "validation")
    cli.at_most(arguments.cases, len(known), "validation instances")
    cases = known[: arguments.cases]
    keep = cli.DATA / "optimal" / problem.id
    optimum = track_optimum(problem, cases.parameters, cases.cost, shipped(problem), keep)
    rows = [optimum.row]
    for name, plant in (("stabiliser", problem), ("stabiliser, in a wide box", widened(problem))):
        method = Method(name, Stabiliser(plant))
        row, _ = run(plant, method, cases.parameters, baseline=optimum.baseline, batches=())
        rows.append(row)
        cli.say(f"{name}: {row.metrics.success.count} of {len(cases)}; {row.metrics.left_box} leave the box")
    record = Sensitivity(env_id=problem.id, cases=len(cases), rows=tuple(rows), provenance=provenance())
    cli.publish(arguments, f"stabiliser_{problem.id}", record)
    cli.say(text_table(rows, COLUMNS))


if __name__ == "__main__":
    cli.run(main)
