"""What the databases of an environment hold and how good they are, as text, as JSON and as a figure.

Every stored trajectory is checked anew, and a random subset of the best plans is integrated with SciPy's DOP853.

    python scripts/report_data.py                # writes results/data_<env-id>.json and .png
    python scripts/report_data.py --env GroundVehicle-v0 --splits training validation
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ocp_envs
from moe_policy.experiments.data import CLOSE, FAILURES, LEVELS, accuracy_of, contents, data_figure
from moe_policy.experiments.tables import DASH, keyed, text_table
from ocp_envs.data.database import Database
from ocp_envs.sets.splits import split_of, splits_of
from ocp_envs.solvers.accuracy import ATOL, RTOL
from ocp_envs.support.provenance import provenance, write_json

ROOT = Path(__file__).resolve().parents[1]
#: Seed of the choice of the plans that are integrated.
SEED = 505

Record = Mapping[str, Any]


def percent(share: float | None) -> str:
    return DASH if share is None else f"{100 * share:.3g} %"


def several(values: Mapping[str, float] | None, form: str) -> str:
    return DASH if values is None else " / ".join(format(value, form) for value in values.values())


def words(name: str) -> str:
    return name.lower().replace("_", " ")


def effort_lines(record: Record) -> dict[str, str]:
    """What solving took and how it ended, by heading."""
    known, ended = record["failures_by_kind"], record["unsolved_by_first_solve"]
    unsolved = ", ".join(f"{count:,} {words(name)}" for name, count in ended.items() if count)
    kinds = "not stored" if known is None else " / ".join(f"{known[kind.name]:,}" for kind in FAILURES)
    return {
        "problems": f"{record['problems']:,} of {record['size']:,}",
        "solved": f"{record['solved']:,}",
        "unsolved, by their first solve": unsolved or "none",
        "solves (per problem)": f"{record['solves']:,} ({record['solves_per_problem']:.2f})",
        "failed solves": f"{record['failures']:,}",
        f"… {' / '.join(words(kind.name) for kind in FAILURES)}": kinds,
        "… timed out or crashed, at most": f"{record['timed_out_or_crashed_at_most']:,}",
        "solves by the fallback": f"{record['fallbacks']:,}",
        "iterations (per solve)": f"{record['iterations']:,} ({record['iterations_per_solve']:.2f})",
    }


def contents_lines(record: Record) -> dict[str, str]:
    """What is stored, by heading."""
    gap = record["gap"]
    below = gap["share_below"] or {}
    lines = {
        "size of the files": f"{record['bytes'] / 1e6:.1f} MB",
        "trajectories, all checked anew": f"{record['trajectories']:,}",
        "… failing the check": f"{record['failing_the_check']:,}",
        "… in the slot of another mode": f"{record['in_the_slot_of_another_mode']:,}",
        "problems with 0 / 1 / … modes": " / ".join(f"{count:,}" for count in record["modes_found"]),
    }
    for row in record["classes"]:
        lines[f"cheapest: {row['mode']}"] = f"{row['best']:,} ({percent(row['share'])}); found {row['found']:,}"
    lines[f"gap, {' / '.join(f'{100 * level:g}' for level in LEVELS)} % quantile"] = several(gap["quantiles"], ".3g")
    return lines | {f"gap below {100 * limit:g} %": percent(below.get(f"{limit:g}")) for limit in CLOSE}


def accuracy_lines(record: Record | None) -> dict[str, str]:
    """How accurate the plans are, by heading."""
    if record is None:
        return {}
    lines = {
        f"error {name}, {words(unit)}": several(record[kind][unit], ".1e")
        for kind, name in (("interval", "per interval"), ("open_loop", "open loop"))
        for unit in ("state_units", "scaled")
    }
    ended = f"{record['end_in_the_goal_ball']:,} of {record['cases']:,}"
    return lines | {"open loop ends in the goal ball": ended, "not integrable": f"{record['not_integrable']:,}"}


def text(title: str, records: Mapping[str, Record]) -> str:
    """The report, one column for each split."""
    columns = {
        name: effort_lines(record) | contents_lines(record) | accuracy_lines(record["accuracy"])
        for name, record in records.items()
    }
    headings = dict.fromkeys(heading for lines in columns.values() for heading in lines)
    rows = [{"": heading, **{name: lines.get(heading) for name, lines in columns.items()}} for heading in headings]
    notes = [
        "gap: (second best − best) / best over the problems in which two modes or more were found; modes that cost",
        "neighbours more than the margin in the settings of the generation are not sought, so wide gaps are told less",
        f"error: norm against DOP853 (rtol {RTOL:g}, atol {ATOL:g}), median / 95 % / largest",
        "solves by the fallback: every hang and every crash of the first solver is among them",
    ]
    if any(record["failures_by_kind"] is None for record in records.values()):
        notes.append("not stored: databases keep how many solves of a problem failed, not how each of them ended")
    return "\n".join([title, "", text_table(rows, [keyed(name, name) for name in ("", *columns)]), *notes]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="PendulumSwingup-v0", help="name of the environment")
    parser.add_argument("--splits", nargs="+", help="which sets; by default all that are there")
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="folder of the databases")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder of the record and the figure")
    parser.add_argument("--accuracy-cases", type=int, default=300, help="plans of each set that are integrated")
    arguments = parser.parse_args()
    if arguments.accuracy_cases < 1:
        parser.error(f"--accuracy-cases must be at least 1, got {arguments.accuracy_cases}")

    problem = ocp_envs.load(arguments.env)
    paths = {name: arguments.data / problem.id / f"{name}.zarr" for name in arguments.splits or splits_of(problem)}
    if arguments.splits is None:
        paths = {name: path for name, path in paths.items() if path.exists()}
    if not paths:
        raise SystemExit(f"there are no databases in {arguments.data / problem.id}; make them with generate_data.py")
    reports, records = {}, {}
    for name, path in paths.items():
        split_of(problem, name)  # names the nearest split where there is none
        database = Database.open(path, problem)
        held, found = contents(database), accuracy_of(database, arguments.accuracy_cases, SEED)
        reports[name] = held, found
        accuracy = None if found is None else found.record()
        records[name] = held.record() | {"accuracy": accuracy, "settings": database.settings}

    print(text(f"{problem.id}: {problem.title}", records))
    output = arguments.results / f"data_{problem.id}.json"
    write_json(
        output,
        {
            "problem": problem.id,
            "splits": records,
            "integration": {"method": "DOP853", "rtol": RTOL, "atol": ATOL, "seed": SEED},
            "provenance": provenance(),
        },
    )
    print(f"wrote {output}")
    print(f"wrote {data_figure(output.with_suffix('.png'), reports)}")


if __name__ == "__main__":
    main()
