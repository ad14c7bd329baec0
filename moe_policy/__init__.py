"""Learning the solutions of parametric optimal control problems, and tracking the plans that were learnt.

Names are imported on first use: rolling out a policy does not load PyTorch, and Stable-Baselines3 may be absent. The
public names and their modules are listed in ``__init__.pyi``, which type checkers read.
"""

import os
import sys

from ocp_envs import __version__ as __version__
from ocp_envs.support.public_names import public_names

__all__, __getattr__, __dir__ = public_names(__name__, __file__)


def _calculate_in_one_thread() -> None:
    """PyTorch's threads do not exist in a forked process, where a network would wait for them for ever."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_calculate_in_one_thread)
