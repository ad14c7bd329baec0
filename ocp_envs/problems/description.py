"""The documentation of a problem, derived from its declaration."""

from __future__ import annotations

import math

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.doors import checked
from ocp_envs.system import Box


def _number(value: float) -> str:
    turns = value / math.pi
    if turns and abs(turns - round(turns)) < 1e-12:
        return {1: "π", -1: "−π"}.get(round(turns), f"{round(turns)}π").replace("-", "−")
    return f"{value:g}".replace("-", "−")


def _table(box: Box) -> str:
    rows = [
        f"| {i} | {c.name} | {_number(c.lower)} | {_number(c.upper)} | {c.unit} | "
        f"{'' if c.period is None else _number(c.period)} |"
        for i, c in enumerate(box.coordinates)
    ]
    return "\n".join(["| | name | lower | upper | unit | period |", "|---|---|---|---|---|---|", *rows])


def _final(name: str, lower: float, upper: float) -> str:
    """The final values of a coordinate; "" where it is free."""
    if lower == upper:
        return f"{name} = {_number(lower)}"
    sides = (
        f"{_number(lower)} ≤ " if math.isfinite(lower) else "",
        f" ≤ {_number(upper)}" if math.isfinite(upper) else "",
    )
    return f"{sides[0]}{name}{sides[1]}" if any(sides) else ""


def _goal(problem: OptimalControlProblem) -> str:
    """The final states of ``problem``, in the central context where they depend on it."""
    names, turns = problem.system.state.names, len(problem.goal.windings_of(problem.system.nx))
    lower, upper = (part[0, ::turns] for part in problem.terminal.bounds(problem.context.centre[None]))
    winding = problem.goal.windings_of(problem.system.nx)[0] * problem.system.state.periods
    alternatives = []
    for low, high in zip(lower - winding, upper - winding):
        sides = (_final(*each) for each in zip(names, low.tolist(), high.tolist()))
        alternatives.append(", ".join(side for side in sides if side) or "any state")
    text = ", or ".join(alternatives)
    periodic = [c.name for c in problem.system.state.coordinates if c.period is not None]
    text += f", {', '.join(periodic)} modulo whole turns" if periodic else ""
    if problem.terminal.n_inequalities or problem.terminal.n_equalities:
        text += f", with {problem.terminal.n_inequalities + problem.terminal.n_equalities} final constraints"
    return f"{text} in the middle of the box, a function of the context" if problem.terminal.depends else text


def _reward(problem: OptimalControlProblem) -> str:
    cost = "the cost ∫L dt of the control step" if problem.cost_rate is not None else "0"
    return f"Minus {cost}" + ("." if problem.terminal_cost is None else ", and minus φ at the end of the episode.")


def _ball(problem: OptimalControlProblem) -> str:
    if problem.goal.tolerance is None:
        return f"within {problem.goal.radius:g} of the goal"
    scaled = ", ".join(
        f"{c.name} / {_number(t)}" for c, t in zip(problem.system.state.coordinates, problem.goal.tolerance)
    )
    return f"within {problem.goal.radius:g} of the goal in the coordinates {scaled}"


@checked
def describe(problem: ProblemOrId) -> str:
    """Spaces, parameters, goal and limits of ``problem`` in Markdown, under the headings that Gymnasium's pages use."""
    problem = problem_of(problem)
    parameters = f"Given by the parameter p, {problem.distribution.text}, in the box\n\n{_table(problem.parameters)}"
    sections = {
        "Description": f"{problem.title[0].upper()}{problem.title[1:]}.",
        "Action Space": _table(problem.system.control),
        "Observation Space": _table(Box((*problem.system.state.coordinates, *problem.context.coordinates))),
        "Reward": _reward(problem),
        "Starting State": parameters,
        "Episode End": (
            f"Terminated {_ball(problem)} ({_goal(problem)}){' at the given time' if problem.horizon.fixed else ''} "
            f"or outside the observation space; truncated after {problem.time_limit:g} s."
        ),
        "Physical Constants": ", ".join(f"{k} = {_number(v)}" for k, v in problem.system.constants.items()) + ".",
    }
    return "\n\n".join([f"# {problem.id}", *(f"## {heading}\n\n{text}" for heading, text in sections.items())]) + "\n"
