"""A problem of your own, from its declaration to a trained mixture of experts: the swing-up of a pole on a cart."""

import argparse
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import moe_policy
import ocp_envs
from ocp_envs import Box, Coordinate, Goal, OptimalControlProblem, System, winding_modes


# 1. The system ẋ = f(x, u, constants), in CasADi expressions, of Kelly, "An introduction to trajectory optimization".
def dynamics(state: Any, control: Any, c: Any) -> list[Any]:
    _, theta, v, omega = state
    s, k, inertia = ca.sin(theta), ca.cos(theta), c.cart + c.pole * ca.sin(theta) ** 2
    push = control[0] + c.length * c.pole * s * omega**2
    acceleration = (push + c.pole * c.gravity * k * s) / inertia
    turn = -(push * k + (c.cart + c.pole) * c.gravity * s) / (c.length * inertia)
    return [v, omega, acceleration, turn]


STATE = (
    Coordinate("x", -5.0, 5.0, "m"),
    Coordinate("theta", -4 * np.pi, 4 * np.pi, "rad", scale=3.0, period=2 * np.pi),
    Coordinate("v", -20.0, 20.0, "m/s", scale=3.0),
    Coordinate("omega", -25.0, 25.0, "rad/s", scale=5.0),
)
CART_POLE = System(
    name="cart and pole",
    state=Box(STATE),
    control=Box((Coordinate("force", -15.0, 15.0, "N", scale=5.0),)),
    constants={"cart": 1.0, "pole": 0.3, "length": 0.5, "gravity": 9.81},
    dynamics=dynamics,
)
# 2. The problem. Coordinates that are no parameters start at the goal's value. θ = 0 hangs; odd multiples of π are up.
WINDINGS = np.array([[0, k, 0, 0] for k in (-2, -1, 0, 1)])
PROBLEM = OptimalControlProblem(
    id="PoleOnCart-v0",
    title="swing a pole up and stop it above its cart",
    system=CART_POLE,
    parameters=Box((Coordinate("theta", -np.pi, np.pi, "rad"), Coordinate("omega", -3.0, 3.0, "rad/s"))),
    cost_rate=lambda state, control, context, c: 1 + 0.02 * control[0] ** 2,
    goal=Goal(state=np.array([0, np.pi, 0, 0]), radius=0.1, windings=WINDINGS, control=np.zeros(1)),
    duration=(0.2, 5.0),
    knots=31,
    substeps=2,
    modes=winding_modes(("-3 pi", "-pi", "pi", "3 pi")),
    hold=5.0,
    time_limit=12.0,
)
# 3. Registered, it is an environment like the others; it is solved and learned by its name, too.
ocp_envs.register(PROBLEM)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=1500, help="training problems")
    parser.add_argument("--epochs", type=int, default=1000, help="passes over them")
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[1] / "data", help="folder of databases")
    arguments = parser.parse_args()
    if min(arguments.problems, arguments.epochs) < 1:
        parser.error("--problems and --epochs: expected whole numbers of 1 or more")
    # 4. Solved, a database of the best trajectories; 5. learnt by a single network and by mixtures, and both tracked.
    p, path = ocp_envs.sample(PROBLEM, seed=0, n=arguments.problems), arguments.data / PROBLEM.id / "training.zarr"
    database = ocp_envs.generate(PROBLEM, path, p, progress=True)
    settings = moe_policy.TrainingSettings(epochs=arguments.epochs)
    print(moe_policy.compare(PROBLEM, database, settings=settings, progress=True))


if __name__ == "__main__":
    main()
