"""What planners and learners are given, and what a planner's data and training took.

A learner spends environment steps: one simulated state each, ``period`` seconds after the last. A planner spends solves
of the optimal control problem. Counted in simulated states (the problem has N knots) that is

    states_of_solutions  = solves × N                       what the solutions hold
    states_of_iterations = iterations of the solver × N     what was simulated on the way to them, the honest figure

and an iteration takes first and second derivatives of the dynamics beside the states, which no simulator gives. Where a
planner was trained on n of the M problems that were solved, n/M of what all took is counted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from moe_policy.experiments.curves import FOLLOWED, Record
from moe_policy.experiments.tables import duration, keyed
from moe_policy.rollouts.intervals import Spread
from ocp_envs.problem import OptimalControlProblem

#: What each side is given, word for word in every record.
GIVEN = {
    "planners": (
        "The model: dynamics, cost and constraints with their first and second derivatives, in a solver; the modes of "
        "the optimum where clusters are custom ones; and for the tracking the model's linearisation. Problems and "
        "solutions of the training set alone; settings were chosen on the development set."
    ),
    "learners": (
        "Samples of the environment alone: features of the state and the context, rewards (scaled, and where the "
        "settings say so shaped with the distance to the goal, or less a price on it), and, where these say so, many "
        "episodes that start near the goal. The hold after the goal is the same linear regulator as the planners'. The "
        "best actor is chosen on the development set; the episodes of these evaluations are no steps, but their time "
        "is in the wall time."
    ),
    "steps": (
        "A learner's environment step is one simulated state. A planner's budget is given twice: solves × knots, the "
        "states of the solutions, and iterations of the solver × knots, the states simulated on the way to them; an "
        "iteration also takes derivatives, which no step gives."
    ),
    "wall_time": (
        "A learner's is that of one process with one thread, its evaluations included. A planner's is that of the "
        "generation of its data, on as many processes as `workers` says, and of its training in one process. Other "
        "processes ran beside some of them, so that equal runs took different times: `seconds` has one a seed."
    ),
}


@dataclass(frozen=True)
class PlannerBudget:
    """What a planner's data and training took.

    Args:
        samples: problems it was trained on.
        knots: N.
        solves, iterations: of the solver, for these problems.
        generation_seconds: wall time of the generation; ``None`` where no record has it.
        workers: processes of the generation.
        estimated: figures are a share of a larger set's, or times those of the unrecorded part of an interrupted
            generation.
        training_seconds: wall time of the training, one a seed.
    """

    samples: int
    knots: int
    solves: int
    iterations: int
    generation_seconds: float | None
    workers: int
    estimated: bool
    training_seconds: tuple[float, ...]

    @classmethod
    def of(
        cls,
        problem: OptimalControlProblem,
        generation: Mapping[str, Any],
        samples: int,
        training_seconds: Sequence[float],
    ) -> PlannerBudget:
        """The budget of a planner from the record ``generation`` of the training set (scripts/generate_data.py).

        Raises:
            ValueError: more samples than problems were solved.
        """
        problems, begun = generation["problems"], generation.get("resumed_from", 0)
        if not 0 < samples <= problems:
            raise ValueError(
                f"{problem.id}: expected 1 to {problems} samples, as many as problems were solved, got {samples}; "
                "make the records of data and training from the same database"
            )
        share, seconds = samples / problems, generation.get("seconds")
        if seconds is not None:
            seconds = seconds * share * problems / (problems - begun) if begun < problems else None
        return cls(
            samples=samples,
            knots=problem.knots,
            solves=round(generation["solves"] * share),
            iterations=round(generation["iterations"] * share),
            generation_seconds=seconds,
            workers=generation.get("workers", 1),
            estimated=share < 1 or begun > 0,
            training_seconds=tuple(training_seconds),
        )

    @property
    def states_of_solutions(self) -> int:
        """solves × N."""
        return self.solves * self.knots

    @property
    def states_of_iterations(self) -> int:
        """iterations × N."""
        return self.iterations * self.knots

    @property
    def seconds(self) -> float | None:
        """Wall time of generation and median training, ``None`` where that of the generation is unknown."""
        if self.generation_seconds is None:
            return None
        return self.generation_seconds + float(np.median(self.training_seconds))

    def record(self) -> Record:
        """As JSON."""
        derived = ("states_of_solutions", "states_of_iterations", "seconds")
        return asdict(self) | {name: getattr(self, name) for name in derived}


def generation_record(folder: Path, problem: OptimalControlProblem) -> Record | None:
    """What solving the training set took: with times where scripts/generate_data.py kept them, else its counts alone.

    Of the files in ``folder``, ``generation_<env>.json`` or ``data_<env>.json``; ``None`` where neither tells.
    """
    for name, parts in (("generation", ()), ("data", ("splits",))):
        path = folder / f"{name}_{problem.id}.json"
        record: Any = json.loads(path.read_text()) if path.exists() else {}
        for part in (*parts, "training"):
            record = record.get(part, {})
        if record:
            return dict(record)
    return None


def planner_rows(
    problem: OptimalControlProblem,
    training: Mapping[str, Any],
    generation: Mapping[str, Any] | None,
    names: Sequence[str],
    cases: int,
) -> list[Record]:
    """What planners got on the validation set for what budget, one row for each number of training problems, as JSON.

    Args:
        problem: the problem.
        training: the record of scripts/compare_training.py.
        generation: of :func:`generation_record`.
        names: of the planners.
        cases: validation cases, for records that do not tell.
    """
    rows: dict[tuple[str, int], Record] = {}
    for row in (*training["sizes"], *training["rows"]):
        key = row["name"], row["samples"]
        if row["name"] not in names or key in rows:
            continue
        total, violations = row.get("cases", [cases])[0], row.get("violation", [None])
        budget = None
        if generation is not None:
            budget = PlannerBudget.of(problem, generation, row["samples"], row["training_seconds"]).record()
        rows[key] = {
            "name": row["name"],
            "samples": row["samples"],
            "budget": budget,
            "validation_success": Spread.of((s / total for s in row["success"]), (0, 1)).to_json(),
            "validation_violation": None if violations[0] is None else Spread.of(violations).to_json(),
        }
    return [rows[key] for key in sorted(rows, key=lambda key: (names.index(key[0]), key[1]))]


def budget_rows(record: Mapping[str, Any]) -> list[Record]:
    """The table of a record of scripts/compare_budgets.py, all on the development set.

    Learners: the end of every seed's training, and the shipped actor when it was chosen. Planners: the shipped ones,
    with the states simulated by the solver for their data. At last the tracked optimum.
    """
    rows: list[Record] = []
    for name, run in record["learners"].items():
        for curve in run["curves"]:
            spent = {"states": curve["steps"][-1], "seconds": curve["seconds"][-1]}
            rows.append({"name": f"{name}, seed {curve['seed']}", **spent} | {key: curve[key][-1] for key in FOLLOWED})
        if run["chosen"]:
            spent = {"states": run["chosen"]["steps"], "seconds": run["chosen"]["seconds"]}
            rows.append({"name": f"{name}, the shipped actor", **spent, **run["chosen"]["development"]})
    for row in record["shipped"]:
        budget = row["budget"] or {}
        spent = {"states": budget.get("states_of_iterations"), "seconds": budget.get("seconds")}
        rows.append({"name": row["name"], "solves": budget.get("solves"), **spent, **row["development"]})
    return rows + [{"name": row["name"], **row["development"]} for row in record["levels"]]


BUDGET_COLUMNS = (
    keyed("name", "who"),
    keyed("solves", "solves", ","),
    keyed("states", "simulated states", ","),
    keyed("seconds", "wall time", duration),
    keyed("success", "success", ".1%"),
    keyed("cost_ratio", "cost / optimal", ".3f"),
    keyed("mean_return", "mean return", ".2f"),
    keyed("violation", "mean violation, m", ".3f"),
)
