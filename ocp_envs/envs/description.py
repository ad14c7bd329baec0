"""The documentation of an environment, derived from the declaration of its problem."""

from __future__ import annotations

import importlib
import inspect
import math
import pkgutil
import re

from ocp_envs import problems
from ocp_envs.envs.env import Env
from ocp_envs.envs.interface import Interface
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.doors import checked
from ocp_envs.system import Box

#: An argument in a docstring: its names, and its text, which goes on in the lines that are indented further.
_ARGUMENT = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


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


def _spaces(problem: OptimalControlProblem) -> str:
    """The table at the head of Gymnasium's pages."""
    interface = Interface.of(problem, 0.02)
    rows = {
        "Action Space": f"`Box({interface.action_space.shape}, float32)`",
        "Observation Space": f"`Box({interface.observation_space.shape}, float32)`",
        "import": f'`gymnasium.make("ocp_envs:{problem.id}")`',
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())])


def background(problem: OptimalControlProblem) -> str:
    """Equations, source and decisions of a ``problem`` of the benchmark in Markdown; "" for one of the user.

    They are the docstring of the module that declares it.
    """
    for found in pkgutil.iter_modules(problems.__path__):
        module = importlib.import_module(f"{problems.__name__}.{found.name}")
        if any(value is problem for value in vars(module).values()):
            text = re.sub(r":\w+:(`[^`]+`)", r"\1", inspect.cleandoc(module.__doc__ or ""))
            return text.replace("``", "`")
    return ""


def _description(problem: OptimalControlProblem) -> str:
    title = f"{problem.title[0].upper()}{problem.title[1:]}."
    return "\n\n".join(part for part in (title, background(problem)) if part)


def _constraints(problem: OptimalControlProblem) -> str:
    """The constraints of trajectories other than the boxes, in words."""
    at = "the knots" if problem.clearance_points == 1 else f"{problem.clearance_points} points of each interval"
    counts = {
        f'of the state alone (h ≥ 0), which plans keep at {at}; `info["violation"]` says how far they are violated': (
            problem.n_clearances
        ),
        "of state and control (g ≥ 0), which plans keep at the knots": int(problem.inequalities is not None),
        "equalities of state and control (e = 0), which plans keep at the knots": int(problem.equalities is not None),
    }
    found = [f"- {what}" + (f": {count}" if count > 1 else "") for what, count in counts.items() if count]
    narrowed = ", ".join(
        f"{name} in [{_number(low)}, {_number(high)}]" for name, (low, high) in (problem.planned or {}).items()
    )
    found += [f"- plans keep {narrowed}"] if narrowed else []
    return "\n".join(found) or "The boxes of states and controls alone."


def _plans(problem: OptimalControlProblem) -> str:
    shortest, longest = (f"{t:g}" if isinstance(t, float) else "f(context)" for t in problem.duration)
    duration = shortest if shortest == longest else f"{shortest} … {longest}"
    families = ", ".join(f"`{name}`" for name in problem.modes.names)
    regulation = f"{problem.hold:g} s after the plan's end" if problem.hold else "at the plan's end"
    return (
        f"A trajectory has {problem.knots} knots, {problem.substeps} Runge-Kutta "
        f"{'step' if problem.substeps == 1 else 'steps'} in each interval, and a duration of {duration} s: "
        f"{problem.flat_size} numbers. Success is evaluated {regulation}. Solution families: {families}."
    )


def _arguments() -> str:
    """The arguments of an environment, from its docstring."""
    listed = re.split(r"^\w+:$", inspect.cleandoc(Env.__doc__ or "").partition("\nArgs:\n")[2], flags=re.MULTILINE)[0]
    texts = {name: " ".join(text.replace("``", "`").split()) for name, text in _ARGUMENT.findall(listed)}
    parameters = inspect.signature(Env).parameters
    rows = [
        f"| `{name}` | `{parameters[name].default!r}` | {text} |"
        for name, text in texts.items()
        if parameters[name].default is not inspect.Parameter.empty
    ]
    return "\n".join(["| argument | default | |", "|---|---|---|", *rows])


@checked
def describe(problem: ProblemOrId) -> str:
    """The page of ``problem`` in Markdown, under the headings that Gymnasium's pages use.

    It has the spaces, the parameters, the goal, the limits, the arguments of the environment and what trajectories
    are, and for a problem of the benchmark its equations and their source.

    Raises:
        UnknownProblemError: no problem of that name.
    """
    problem = problem_of(problem)
    parameters = f"Given by the parameter p, {problem.distribution.text}, in the box\n\n{_table(problem.parameters)}"
    sections = {
        "Description": _description(problem),
        "Action Space": _table(problem.system.control),
        "Observation Space": _table(Box((*problem.system.state.coordinates, *problem.context.coordinates))),
        "Rewards": _reward(problem),
        "Starting State": parameters,
        "Episode End": (
            f"Terminated {_ball(problem)} ({_goal(problem)}){' at the given time' if problem.horizon.fixed else ''} "
            f"or outside the observation space; truncated after {problem.time_limit:g} s."
        ),
        "Physical Constants": ", ".join(f"{k} = {_number(v)}" for k, v in problem.system.constants.items()) + ".",
        "Constraints": _constraints(problem),
        "Optimal Trajectories": _plans(problem),
        "Arguments": _arguments(),
    }
    return (
        "\n\n".join(
            [f"# {problem.id}", _spaces(problem), *(f"## {heading}\n\n{text}" for heading, text in sections.items())]
        )
        + "\n"
    )
