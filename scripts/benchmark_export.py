"""Policies as C: size, and the time of a plan, of the regulators along it and of a control step, against Python.

Shipped networks of all problems are written by ``TrackingPolicy.to_c``, compiled with the flags that the record names,
and compared with Python in the same run on one core: plans, and controls along equal plans. Times of both are means
over many calls, medians over interleaved rounds. Writes ``benchmark_export.json``.

    python scripts/benchmark_export.py
"""

import moe_policy
import ocp_envs
from moe_policy.experiments import cli
from moe_policy.experiments.speed.exports import FLAGS, ExportRow, Exports, export_row
from moe_policy.reports.tables import Column, duration, text_table
from ocp_envs.problems import PAPER
from ocp_envs.support.provenance import provenance

DT = 0.02
PLANNERS = ("snn", "moe-custom", "moe-kmeans-4")
COLUMNS: tuple[Column[ExportRow], ...] = (
    Column("policy", lambda row: f"{row.env_id}, {row.planner}"),
    Column("library, kB", lambda row: row.library_bytes / 1e3, ".0f"),
    Column("state, kB", lambda row: row.state_bytes / 1e3, ".0f"),
    Column("plan", lambda row: row.in_c.plan, duration),
    Column("in Python", lambda row: row.in_python.plan, duration),
    Column("regulators", lambda row: row.in_c.regulators, duration),
    Column("in Python", lambda row: row.in_python.regulators, duration),
    Column("step", lambda row: row.in_c.step, duration),
    Column("in Python", lambda row: row.in_python.step, duration),
    Column("predict", lambda row: row.predict_seconds, duration),
    Column("difference of controls", lambda row: row.control_difference, ".0e"),
)


def main() -> None:
    parser = cli.parser(__doc__, env=None, seed=808, cases="instances of each problem", default_cases=20)
    parser.add_argument("--calls", type=cli.positive, default=300, help="plans in a round; 100 times as many steps")
    parser.add_argument("--rounds", type=cli.positive, default=5, help="interleaved rounds; the median counts")
    arguments = parser.parse()
    cli.threads()
    cli.one_core()

    rows = []
    for problem in PAPER:
        p = ocp_envs.sample(problem, arguments.seed, arguments.cases)
        for name in PLANNERS:
            if name in moe_policy.available(problem):
                policy = moe_policy.TrackingPolicy(problem, moe_policy.load_planner(problem, name), DT)
                rows.append(export_row(policy, p, arguments.calls, arguments.rounds))
                cli.say(text_table(rows[-1:], COLUMNS))
    record = Exports(dt=DT, flags=FLAGS, rows=tuple(rows), provenance=provenance())
    cli.publish(arguments, "benchmark_export", record)


if __name__ == "__main__":
    cli.run(main)
