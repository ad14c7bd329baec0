"""Animate an optimal episode of an environment: the best known trajectory of one instance, tracked with LQR.

Writes ``<env>.webp``, the animation on the page of the environment.
"""

from collections.abc import Sequence

import numpy as np
from PIL import Image

import moe_policy
import ocp_envs
from moe_policy.experiments import cli
from ocp_envs.problem import OptimalControlProblem

SHIPPED = cli.ROOT / "docs" / "animations"
#: The instances: each at a side of the discontinuity where the problem has one.
INSTANCES = {
    "PendulumSwingup-v0": (0.4, 0.0),
    "GroundVehicle-v0": (9.0, -7.0, 0.6, -2.0),
    "Quadcopter-v0": (8.0, -7.0, -6.0),
    "QuadcopterObstacle-v0": (8.0, 6.0, -4.0, 4.0, 3.2, -1.6, 2.5),
    "PendulumUncertain-v0": (0.4, 0.0, 1.25, 0.8),
    "CartPoleSwingup-v0": (0.0, 0.0),
    "RocketLanding-v0": (230.0, 850.0, 15.0, -20.0),
}
#: Frames of an animation, and its width and height in pixels.
FRAMES, SIZE = 50, 320


def frames(problem: OptimalControlProblem, p: Sequence[float]) -> tuple[list[Image.Image], float]:
    """Pictures of the tracked optimum from ``p`` at equal intervals, and the seconds between two of them."""
    plan = ocp_envs.solve(problem, p).trajectory
    parameters = np.array([p])
    policy = moe_policy.TrackingPolicy(problem, moe_policy.StoredPlans(parameters, plan), dt=0.02)
    env = ocp_envs.Env(problem, dt=0.02, terminate_at_goal=False, render_mode="rgb_array")
    observation, _ = env.reset(options={"parameters": p})
    env.show_plan(plan)
    steps = round(float(plan.duration[0]) / 0.02)
    shown = set(np.linspace(0, steps, FRAMES).round().astype(int).tolist())
    state, pictures = policy.start(parameters), []
    for step in range(steps + 1):
        if step in shown:
            picture = env.render()
            assert picture is not None
            pictures.append(Image.fromarray(picture).resize((SIZE, SIZE), Image.Resampling.LANCZOS))
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
    return pictures, steps * 0.02 / (FRAMES - 1)


def main() -> None:
    parser = cli.parser(__doc__, ship="write into docs/animations/ instead of runs/")
    arguments = parser.parse()
    problem = arguments.problem
    p = INSTANCES.get(problem.id) or ocp_envs.sample(problem, seed=0, n=1)[0]
    pictures, interval = frames(problem, p)
    path = (SHIPPED if arguments.ship else arguments.results) / f"{problem.id}.webp"
    path.parent.mkdir(parents=True, exist_ok=True)
    times = [round(1000 * interval)] * (len(pictures) - 1) + [1500]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=times, loop=0, quality=45, method=6)
    cli.say(f"wrote {path}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    cli.run(main)
