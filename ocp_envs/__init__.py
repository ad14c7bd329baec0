"""Parametric optimal control problems as Gymnasium environments, with known optimal trajectories.

``import ocp_envs`` registers the environments; ``gymnasium.make("ocp_envs:PendulumSwingup-v0")`` does so by itself::

    env = gymnasium.make("ocp_envs:PendulumSwingup-v0")
    observation, info = env.reset(options={"parameters": [0.5, 0.0]})
    solution = ocp_envs.solve("PendulumSwingup-v0", [0.5, 0.0])  # .cost, .trajectory, and the best of each family

Problems
    ``names``, ``load``, ``register`` and ``describe``; a problem of your own is an ``OptimalControlProblem`` of a
    ``System``, a ``Box`` of parameters and a ``Goal``, and ``check`` says whether it fits together.
Environments
    ``Env`` and ``VectorEnv``, or ``gymnasium.make`` and ``gymnasium.make_vec``; ``Simulator`` without Gymnasium.
Optima
    ``solve`` for one instance, ``solve_many`` for several, ``generate`` for a ``Database`` on disk, which ``refine``
    improves.
Instances
    ``sample`` and ``grid``; ``load_reference`` for the shipped ones with their costs.

``python -m ocp_envs.info`` describes a database or a problem. Planners and policies are in ``moe_policy``. Names are
imported on first use: stepping an environment needs no solver and no database. The public names and their modules are
listed in ``__init__.pyi``, which type checkers read.
"""

from __future__ import annotations

from ocp_envs.problems import BENCHMARK, register
from ocp_envs.support.public_names import public_names

#: The version of the project; ``pyproject.toml`` reads it here.
__version__ = "0.1.0"

__all__, __getattr__, __dir__ = public_names(__name__, __file__)

for _problem in BENCHMARK:
    register(_problem)
