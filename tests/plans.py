"""Plans that are dynamically exact, and policies in the simulator."""

import numpy as np

from ocp_envs.envs.simulation import Simulator
from ocp_envs.trajectory import Trajectory

DT = 0.02


def smallest_contexts(problem, size):
    """The values in the box of contexts that are nearest to 0, (size, nc)."""
    return np.tile(np.clip(0.0, problem.context.lower, problem.context.upper), (size, 1))


def random_plan(problem, size, seed=0, spread=0.3):
    """Dynamically exact plans: random initial states and controls, the intervals integrated finely."""
    rng = np.random.default_rng(seed)
    flow = problem.functions.flow(20)
    duration = rng.uniform(1.0, 3.0, size)
    step = duration[:, None] / (problem.knots - 1)
    box = problem.system.control
    noise = rng.uniform(-1, 1, (size, problem.knots - 1, problem.system.nu))
    controls = np.clip(problem.terminal.central_control + spread * noise, box.lower, box.upper)
    contexts = smallest_contexts(problem, size)
    states = [
        problem.start(rng.uniform(problem.parameters.lower, problem.parameters.upper, (size, len(problem.parameters))))[
            0
        ]
    ]
    for i in range(problem.knots - 1):
        states.append(flow(states[-1], controls[:, i], contexts, step)[0])
    return Trajectory(np.stack(states, axis=1), controls, duration), contexts


def replay(problem, policy, state, states, steps, contexts=None):
    """States (B, steps+1, nx) and controls (B, steps, nu) of a policy in the simulator."""
    contexts = smallest_contexts(problem, len(states)) if contexts is None else contexts
    simulator, xs, us = Simulator(problem, policy.dt), [states], []
    for _ in range(steps):
        u, state = policy.predict(np.concatenate([xs[-1], contexts], axis=1), state)
        us.append(u)
        xs.append(simulator.advance(xs[-1], u, contexts).states)
    return np.stack(xs, axis=1), np.stack(us, axis=1)
