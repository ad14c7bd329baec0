"""Learning the solutions of parametric optimal control problems, and tracking the plans that were learnt.

A planner maps the parameters of an instance to a trajectory; a policy maps observations to controls::

    planner = moe_policy.load("PendulumSwingup-v0", "moe-custom")  # available() lists what is shipped
    plan = planner([0.5, 0.0])
    policy = moe_policy.TrackingPolicy("PendulumSwingup-v0", planner)  # .predict, as in Stable-Baselines3
    envs = moe_policy.environments("PendulumSwingup-v0", 100)
    episodes = moe_policy.rollout(envs, policy, ocp_envs.sample("PendulumSwingup-v0", seed=0, n=100))
    print(moe_policy.evaluate("PendulumSwingup-v0", episodes))

Shipped models
    ``available``, ``load``, ``load_planner`` and ``load_policy``; ``load_file`` for those that you saved.
Learning
    ``cluster``, ``fit_single`` and ``fit_mixture`` on a database of ``ocp_envs``; ``compare`` does all of it.
Planners
    ``NetworkPlanner``, ``NearestPlanner`` and ``SolverPlanner``; ``Repaired`` and ``Checked`` improve and check plans.
Policies
    ``TrackingPolicy`` follows plans, ``Stabiliser`` regulates at the goal, ``Stabilised`` does so after another policy;
    ``train`` trains reinforcement learners (extra ``rl``).
Measuring
    ``environments``, ``rollout`` and ``evaluate``; ``score_method``, or ``python -m moe_policy.score``, measures a
    method of yours on the fixed instances. ``export_minari`` keeps episodes as a dataset of Minari (extra ``minari``).

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
