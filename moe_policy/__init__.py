"""Learning the solutions of parametric optimal control problems, and following what was learnt.

Names are imported on first use: rolling out a policy does not load PyTorch, and Stable-Baselines3 may be absent.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOME = {
    "moe_policy.planners.networks": ("Argmax", "MixtureOfExperts", "SingleNetwork", "Softmax"),
    "moe_policy.learning.architectures": ("Architecture", "Experts"),
    "moe_policy.planners.scaling": ("Standardizer",),
    "moe_policy.learning.clustering": ("Labels", "cluster"),
    "moe_policy.planners.record": ("PartReport", "TrainingReport"),
    "moe_policy.learning.settings": ("Annealing", "TrainingSettings"),
    "moe_policy.learning.training": ("fit_mixture", "fit_single"),
    "moe_policy.learning.joint": ("fit_mixture_jointly", "retrain"),
    "moe_policy.planners.prediction_error": ("standardised_error", "validation_error"),
    "moe_policy.planners.nearest": ("NearestPlanner",),
    "moe_policy.planners.network": ("NetworkPlanner",),
    "moe_policy.protocols": ("Planner", "Policy", "Schedule"),
    "moe_policy.planners.solver": ("BatchSolver", "SolverPlanner"),
    "moe_policy.model_files": ("ModelFileError",),
    "moe_policy.store": ("UnknownModelError", "available", "load", "load_file"),
    "moe_policy.rollouts.environments": ("environments",),
    "moe_policy.rollouts.episodes": ("Episodes",),
    "moe_policy.rollouts.intervals": ("Proportion",),
    "moe_policy.rollouts.metrics": ("CostRatio", "Metrics", "evaluate"),
    "moe_policy.rollouts.rollout": ("rollout",),
    "moe_policy.control.stabiliser": ("Entered", "Stabilised", "Stabiliser"),
    "moe_policy.control.tracking": ("Tracking", "TrackingPolicy"),
    "moe_policy.control.weights": ("TrackingWeights",),
    "moe_policy.rl.actor": ("LearnedPolicy",),
    "moe_policy.rl.evaluation": ("Evaluation",),
    "moe_policy.rl.settings": ("PPOSettings", "SACSettings", "TQCSettings"),
    "moe_policy.rl.training": ("TrainingRun", "train"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
