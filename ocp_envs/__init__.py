"""Parametric optimal control problems as Gymnasium environments, with known optimal trajectories.

``import ocp_envs`` registers the environments; ``gymnasium.make("ocp_envs:PendulumSwingup-v0")`` does so by itself.
Names are imported on first use: stepping an environment needs no solver and no database. The public names and their
modules are listed in ``__init__.pyi``, which type checkers read.
"""

from __future__ import annotations

from ocp_envs.problems import BENCHMARK, register
from ocp_envs.support.public_names import public_names

#: The version of the project; ``pyproject.toml`` reads it here.
__version__ = "0.1.0"

__all__, __getattr__, __dir__ = public_names(__name__, __file__)

for _problem in BENCHMARK:
    register(_problem)
