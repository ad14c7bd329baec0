"""The documentation of a problem, derived from its declaration."""

from __future__ import annotations

import math

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


@checked
def describe(problem: ProblemOrId) -> str:
    """Spaces, parameters, goal and limits of ``problem`` in Markdown, under the headings that Gymnasium's pages use."""
    problem = problem_of(problem)
    goal = ", ".join(
        f"{name} = {_number(value)}" for name, value in zip(problem.system.state.names, problem.goal.state)
    )
    turns = [c.name for c in problem.system.state.coordinates if c.period is not None]
    modulo = f", {', '.join(turns)} modulo whole turns" if turns else ""
    parameters = f"Given by the parameter p, {problem.distribution.text}, in the box\n\n{_table(problem.parameters)}"
    sections = {
        "Description": f"{problem.title[0].upper()}{problem.title[1:]}.",
        "Action Space": _table(problem.system.control),
        "Observation Space": _table(Box((*problem.system.state.coordinates, *problem.context.coordinates))),
        "Reward": "Minus the cost ∫L dt of the control step.",
        "Starting State": parameters,
        "Episode End": (
            f"Terminated within {problem.goal.radius:g} of the goal ({goal}{modulo}) or outside the observation "
            f"space; truncated after {problem.time_limit:g} s."
        ),
        "Physical Constants": ", ".join(f"{k} = {_number(v)}" for k, v in problem.system.constants.items()) + ".",
    }
    return "\n\n".join([f"# {problem.id}", *(f"## {heading}\n\n{text}" for heading, text in sections.items())]) + "\n"
