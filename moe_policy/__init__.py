"""Learning the solutions of parametric optimal control problems, and tracking the plans that were learnt.

Names are imported on first use: rolling out a policy does not load PyTorch, and Stable-Baselines3 may be absent. The
public names and their modules are listed in ``__init__.pyi``, which type checkers read.
"""

from ocp_envs.support.public_names import public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__)
