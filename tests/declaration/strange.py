"""Declarations that cannot work or that say something else than they seem to, and the words that refuse them.

Each is one change of a problem that works; most are slips that are easily made.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from ocp_envs.distribution import Blocked
from ocp_envs.goal import Modes, winding_modes
from ocp_envs.picture import Picture
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import HOVER_THRUST, QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.symmetry import Symmetry
from ocp_envs.system import Box, Coordinate
from tests.small_problems import WALLED_INTEGRATOR

NAN, INF = math.nan, math.inf


class Strange(NamedTuple):
    what: str
    declare: Callable[[], object]
    words: str  #: of the message, a regular expression


def of(problem: OptimalControlProblem, **changes: object) -> Callable[[], object]:
    return lambda: dataclasses.replace(problem, id="Strange-v0", **changes)


def system(problem: OptimalControlProblem = PENDULUM, **changes: object) -> Callable[[], object]:
    return lambda: dataclasses.replace(problem, system=dataclasses.replace(problem.system, **changes))


def goal(problem: OptimalControlProblem = PENDULUM, **changes: object) -> Callable[[], object]:
    return lambda: dataclasses.replace(problem, goal=dataclasses.replace(problem.goal, **changes))


def dynamics(function: object) -> Callable[[], object]:
    return system(dynamics=function)


def cost(function: object) -> Callable[[], object]:
    return of(PENDULUM, cost_rate=function)


def clearance(function: object) -> Callable[[], object]:
    return of(PENDULUM, clearance=function)


def coordinate(**changes: object) -> Callable[[], object]:
    return lambda: dataclasses.replace(PENDULUM.system.state.coordinates[0], **changes)


def parameters(*coordinates: Coordinate, problem: OptimalControlProblem = PENDULUM) -> Callable[[], object]:
    return of(problem, parameters=Box(coordinates))


def classify(values: object) -> Callable[[], object]:
    return of(PENDULUM, modes=Modes(("a", "b", "c"), lambda problem, p, trajectory, multipliers: values))


def symmetry(state: object, control: object, context: object = ()) -> Callable[[], object]:
    return of(QUADCOPTER, symmetry=Symmetry("wrong", state, control, context))


def if_above(x, u, c):
    return [x[1], u[0] if x[0] > 0 else -u[0]]


THETA, OMEGA = PENDULUM.parameters.coordinates
HALF_TURN = QUADCOPTER.symmetry
STRANGE = [
    # numbers of the problem
    Strange("hold is nan", of(PENDULUM, hold=NAN), "hold must be a finite number ≥ 0"),
    Strange("hold is negative", of(PENDULUM, hold=-1.0), "hold must be a finite number ≥ 0"),
    Strange("hold is infinite", of(PENDULUM, hold=INF), "hold must be a finite number ≥ 0"),
    Strange("hold is None", of(PENDULUM, hold=None), "hold must be a finite number ≥ 0, got None"),
    Strange("duration without an end", of(PENDULUM, duration=(0.2, INF)), "duration must be finite"),
    Strange("duration of nan", of(PENDULUM, duration=(NAN, 1.0)), "duration must be finite"),
    Strange("duration reversed", of(PENDULUM, duration=(2.0, 1.0)), "shortest ≤ longest"),
    Strange("duration from 0", of(PENDULUM, duration=(0.0, 1.0)), "0 < shortest"),
    Strange("duration is one number", of(PENDULUM, duration=5.0), "duration must be a pair"),
    Strange("duration of three", of(PENDULUM, duration=(1.0, 2.0, 3.0)), "duration must be a pair"),
    Strange("half a knot", of(PENDULUM, knots=2.5), "knots must be a whole number, knots ≥ 2"),
    Strange("one knot", of(PENDULUM, knots=1), "knots ≥ 2"),
    Strange("knots as text", of(PENDULUM, knots="25"), "knots must be a whole number"),
    Strange("half a substep", of(PENDULUM, substeps=1.5), "substeps must be a whole number"),
    Strange("no substeps", of(PENDULUM, substeps=0), "substeps ≥ 1"),
    Strange("time limit of −1", of(PENDULUM, time_limit=-1.0), "time_limit must be positive"),
    Strange("time limit of nan", of(PENDULUM, time_limit=NAN), "time_limit must be positive"),
    Strange("time limit shorter than plans", of(PENDULUM, time_limit=5.0), "time_limit must be at least the longest"),
    Strange("longest substep of 0", of(PENDULUM, longest_substep=0.0), "longest_substep must be positive"),
    Strange("rest of nan", of(PENDULUM, rest=[NAN, 0.0]), "rest must be finite"),
    Strange("rest of another shape", of(PENDULUM, rest=[0.0]), r"rest must have shape \(2,\)"),
    Strange("rest outside the box", of(PENDULUM, rest=[0.0, 7.0]), "rest has omega = 7, outside its operating box"),
    # parts of another type
    Strange("id without a name", lambda: dataclasses.replace(PENDULUM, id=""), "id must not be empty"),
    Strange(
        "id with a blank", lambda: dataclasses.replace(PENDULUM, id="my problem"), "id must be a name for Gymnasium"
    ),
    Strange("system is None", of(PENDULUM, system=None), "system must be a System, got None"),
    Strange("goal is a state", of(PENDULUM, goal=[0.0, 0.0]), "goal must be a Goal"),
    Strange("cost rate is a number", of(PENDULUM, cost_rate=1.0), "cost_rate must be a function"),
    Strange("clearance is a number", of(PENDULUM, clearance=1.0), "clearance must be a function"),
    Strange("modes are names", of(PENDULUM, modes=("a", "b")), "modes must be a Modes"),
    Strange("picture is a function", of(PENDULUM, picture=lambda x: x), "picture must be a Picture"),
    Strange("distribution is a name", of(PENDULUM, distribution="uniform"), "distribution must be a Distribution"),
    # coordinates and boxes
    Strange("scale of 0", coordinate(scale=0.0), "scale must be positive"),
    Strange("negative scale", coordinate(scale=-1.0), "scale must be positive"),
    Strange("scale of nan", coordinate(scale=NAN), "scale must be positive"),
    Strange("scale as text", coordinate(scale="1"), "scale must be a positive finite number, got '1'"),
    Strange("bounds reversed", coordinate(lower=1.0, upper=-1.0), "lower < upper"),
    Strange("no bound", coordinate(lower=None), "lower must be a finite number, got None"),
    Strange("infinite bound", coordinate(upper=INF), "upper must be a finite number"),
    Strange("period of 0", coordinate(period=0.0), "period must be positive"),
    Strange("name with a blank", coordinate(name="the angle"), "name must be a Python identifier"),
    Strange("name that is a keyword", coordinate(name="lambda"), "identifier and no keyword, got 'lambda'"),
    Strange("name that is a number", coordinate(name=1), "name must be a Python identifier"),
    Strange("a name twice", lambda: Box((THETA, THETA)), "coordinate names must be unique"),
    Strange("no box", lambda: Box(THETA), "coordinates must be a tuple of Coordinate"),
    Strange("a box of names", lambda: Box(("x", "y")), "must be a Coordinate, got 'x'"),
    Strange("no control", system(control=Box(())), "control must have at least one coordinate"),
    Strange("no parameters", of(PENDULUM, parameters=Box(())), "parameters must have at least one coordinate"),
    Strange(
        "initial states outside the box",
        parameters(THETA, dataclasses.replace(OMEGA, upper=20.0)),
        "initial state at the upper ends of parameters has omega = 20, outside its operating box",
    ),
    Strange(
        "a typo in a parameter",
        parameters(dataclasses.replace(THETA, name="thetta"), OMEGA),
        "nothing depends on the parameter 'thetta'; did you mean 'theta'",
    ),
    Strange(
        "a parameter that nothing reads",
        parameters(THETA, OMEGA, Coordinate("wind", 0.0, 1.0)),
        "nothing depends on the parameter 'wind'",
    ),
    # constants
    Strange("constant of nan", system(constants={**PENDULUM.system.constants, "mass": NAN}), "constant 'mass'"),
    Strange("constant as text", system(constants={**PENDULUM.system.constants, "mass": "1"}), "constant 'mass'"),
    Strange(
        "constant without a name", system(constants={**PENDULUM.system.constants, "a b": 1.0}), "name of a constant"
    ),
    Strange(
        "constant called like a state",
        system(constants={**PENDULUM.system.constants, "theta": 1.0}),
        "has the name of a state",
    ),
    Strange("constants in a list", system(constants=[1.0]), "constants must be a Mapping"),
    # dynamics
    Strange(
        "math.sin in dynamics", dynamics(lambda x, u, c: [x[1], u[0] - math.sin(x[0])]), "derivative of 'omega'.*ca.sin"
    ),
    Strange("too few components", dynamics(lambda x, u, c: [x[1]]), "dynamics returned 1 components, expected 2"),
    Strange("too many components", dynamics(lambda x, u, c: [x[1], u[0], 0]), "returned 3 components, expected 2"),
    Strange(
        "dynamics without constants", dynamics(lambda x, u: [x[1], u[0]]), r"called with \(state, control, constants\)"
    ),
    Strange(
        "dynamics with time", dynamics(lambda t, x, u, c: [x[1], u[0]]), r"called with \(state, control, constants\)"
    ),
    Strange("dynamics return None", dynamics(lambda x, u, c: None), "must return a list of expressions.*got None"),
    Strange("dynamics return a column", dynamics(lambda x, u, c: ca.vertcat(x[1], u[0])), "write ca.vertsplit"),
    Strange(
        "dynamics with a vector", dynamics(lambda x, u, c: [ca.vertcat(x[1], 0), u[0]]), "component 0.*one expression"
    ),
    Strange("an if in dynamics", dynamics(if_above), "ca.if_else"),
    Strange(
        "a missing constant", dynamics(lambda x, u, c: [x[1], u[0] / c.mas]), "no constant 'mas'; did you mean 'mass'"
    ),
    Strange(
        "a division by 0",
        dynamics(lambda x, u, c: [x[1], u[0] / (c.mass - 1)]),
        "derivative of 'omega' is .*at the goal",
    ),
    Strange(
        "an infinite rate at the goal", dynamics(lambda x, u, c: [x[1], u[0] + 1 / x[1]]), "'omega' is .*at the goal"
    ),
    # cost rate
    Strange("math.cos in the cost", cost(lambda x, u, s, c: 1 + math.cos(x[0])), "cost_rate is nan.*ca.sin"),
    Strange("a cost of fewer arguments", cost(lambda x, u: 1), r"called with \(state, control, context, constants\)"),
    Strange("a cost of None", cost(lambda x, u, s, c: None), "cost_rate must return one expression, got None"),
    Strange(
        "a cost in a list", cost(lambda x, u, s, c: [1 + u[0] ** 2]), "cost_rate must return one expression, got list"
    ),
    Strange("a cost that is a vector", cost(lambda x, u, s, c: ca.vertcat(*x)), "one expression, got SX of shape"),
    Strange("a missing constant in the cost", cost(lambda x, u, s, c: c.nosuch), "no constant 'nosuch'"),
    Strange("a missing context", cost(lambda x, u, s, c: s.radius), "no context coordinate 'radius'"),
    Strange("max in the cost", cost(lambda x, u, s, c: 1 + max(u[0], 0)), "ca.fmax"),
    Strange(
        "a norm at the goal",
        cost(lambda x, u, s, c: ca.sqrt((x[0] - np.pi) ** 2 + x[1] ** 2)),
        "derivative of cost_rate",
    ),
    Strange("a logarithm at the goal", cost(lambda x, u, s, c: 1 + ca.log(x[1])), "cost_rate is -inf at the goal"),
    # clearance
    Strange("a clearance without a list", clearance(lambda x, s, c: x[0] + 20), "clearance must return a list"),
    Strange("a clearance of None", clearance(lambda x, s, c: None), "clearance must return a list"),
    Strange("an empty clearance", clearance(lambda x, s, c: []), "clearance returned 0 components"),
    Strange(
        "a clearance with a control", clearance(lambda x, u, s, c: [x[0]]), r"called with \(state, context, constants\)"
    ),
    Strange("math in a clearance", clearance(lambda x, s, c: [math.cos(x[0])]), "clearance: component 0 is nan"),
    Strange("a blocked goal", clearance(lambda x, s, c: [x[0] - 4.0]), "the goal violates the path constraint"),
    Strange(
        "a distance from the goal",
        clearance(lambda x, s, c: [ca.norm_2(ca.vertcat(x[0] - np.pi, x[1]))]),
        "derivative of clearance",
    ),
    # goal
    Strange("goal of nan", goal(state=[NAN, 0.0]), "goal: state must be finite"),
    Strange("goal of another shape", goal(state=[np.pi], windings=[[0]]), "expected a goal with state"),
    Strange("goal outside the box", goal(state=[np.pi, 9.0]), "goal.state has omega = 9, outside its operating box"),
    Strange("goal in words", goal(state=["up", 0.0]), "goal: state must be a vector of numbers"),
    Strange("radius of 0", goal(radius=0.0), "radius must be positive"),
    Strange("infinite radius", goal(radius=INF), "radius must be positive and finite"),
    Strange("radius for each state", goal(radius=[0.1, 0.2]), "radius must be a positive finite number"),
    Strange("half a turn", goal(windings=[[0.5, 0], [0, 0], [1, 0]]), "windings must be whole"),
    Strange("no windings", goal(windings=np.zeros((0, 2))), "windings must have at least one row"),
    Strange("windings in one row", goal(windings=[0, 0]), "windings must have at least one row"),
    Strange("a winding twice", goal(windings=[[0, 0], [0, 0], [1, 0]]), "two rows of windings are equal"),
    Strange(
        "turns of a speed", goal(windings=[[0, 1], [0, 0], [1, 0]]), "whole turns of a coordinate without a period"
    ),
    Strange("a winding outside the box", goal(windings=[[-1, 0], [0, 0], [9, 0]]), r"winding \[9, 0\] has theta"),
    Strange("goal control outside its box", goal(QUADCOPTER, control=[9.0] * 4), "goal.control has u1 = 9, outside"),
    Strange("goal control of nan", goal(control=[NAN]), "goal: control must be finite"),
    Strange("goal control of another shape", goal(control=[0.0, 0.0]), "expected a goal with"),
    Strange("a goal that falls", goal(QUADCOPTER, control=[0.9 * HOVER_THRUST] * 4), "hold = 5 s.*equilibrium.*'vz'"),
    Strange("a goal on the way", goal(state=[np.pi / 2, 0.0]), "hold = 5 s.*derivative of 'omega'"),
    Strange("a vehicle held at rest", of(VEHICLE, hold=5.0), "hold = 5 s.*no control moves x, y|x, theta|x there"),
    # families
    Strange(
        "fewer names than windings", of(PENDULUM, modes=winding_modes(("left", "right"))), "a name for each of the 3"
    ),
    Strange("more names than windings", of(PENDULUM, modes=winding_modes(tuple("abcd"))), "a name for each of the 3"),
    Strange("modes without names", lambda: Modes((), lambda *_: np.zeros(1)), "names must be at least one"),
    Strange("a family twice", lambda: winding_modes(("a", "a", "b")), "no two the same"),
    Strange(
        "an index without a name", classify(np.array([0, 1, 3])), r"classify returned \[3\], but modes.names has 3"
    ),
    Strange("a negative index", classify(np.array([0, -1, 2])), r"classify returned \[-1\]"),
    Strange("an index of nan", classify(np.array([0, NAN, 2])), "whole number for each of 3"),
    Strange("one family for all", classify(0), "whole number for each of 3 trajectories"),
    Strange("families of None", classify(None), "whole number for each of 3 trajectories"),
    # symmetries and distributions
    Strange("rotors not exchanged", symmetry(HALF_TURN.state, np.eye(4)), "symmetry 'wrong'.*changes dynamics"),
    Strange("a mirror", symmetry(np.diag([-1.0, 1, 1] * 4), np.eye(4)), "symmetry 'wrong'.*changes"),
    Strange("a symmetry of other sizes", symmetry([1.0], [1.0]), "expected a symmetry of 12 states"),
    Strange(
        "the context not turned",
        of(QUADCOPTER_OBSTACLE, symmetry=dataclasses.replace(HALF_TURN, context=np.eye(4))),
        "changes initial states|changes.*clearance",
    ),
    Strange("blocked by nothing", of(PENDULUM, distribution=Blocked(PENDULUM)), "path constraint"),
    Strange("no wall to pass", of(WALLED_INTEGRATOR, clearance=None), "nothing depends on the parameter 'wall'"),
    Strange("a picture without limits", lambda: Picture((), lambda x, s: [], lambda x: x), "expected limits"),
]
