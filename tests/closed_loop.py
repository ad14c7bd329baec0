"""Environments, planners and policies for rollouts of the small problems."""

from types import SimpleNamespace

import numpy as np

from ocp_envs import VectorEnv
from ocp_envs.trajectory import Trajectory
from tests.small_problems import rest_to_rest


def vector(problem, n, **arguments):
    arguments = {"terminate_at_goal": False, "autoreset_mode": "Disabled", **arguments}
    return VectorEnv(problem, n, **arguments)


def rest_planner(p):
    return Trajectory(*rest_to_rest(p[:, 0], 4.0, 21))


def constant(value, **attributes):
    def predict(observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), 1), value, np.float32), None

    return SimpleNamespace(predict=predict, **attributes)


PARAMETERS = np.array([[2.0, 0.0], [-1.0, 0.0], [0.5, 0.0]])
