"""Learning the solutions of parametric optimal control problems, and following what was learnt.

Names are imported on first use: rolling out a policy does not load PyTorch, and Stable-Baselines3 may be absent.
"""

from __future__ import annotations

import importlib
from typing import Any

# At once, for the function has the name of its module: importing the module later would hide it.
from moe_policy.rollout import Episodes as Episodes
from moe_policy.rollout import environments as environments
from moe_policy.rollout import rollout as rollout

_HOME = {
    "moe_policy.networks": ("Argmax", "MixtureOfExperts", "SingleNetwork", "Softmax"),
    "moe_policy.architectures": ("Architecture", "Experts"),
    "moe_policy.scaling": ("Standardizer",),
    "moe_policy.clustering": ("Labels", "cluster"),
    "moe_policy.fitting": ("PAPER", "TrainingReport", "TrainingSettings"),
    "moe_policy.training": (
        "Annealing",
        "fit_mixture",
        "fit_mixture_jointly",
        "fit_single",
        "retrain",
        "test_error",
        "validation_error",
    ),
    "moe_policy.planner": ("NearestPlanner", "NetworkPlanner", "Planner"),
    "moe_policy.optimal": ("SolverPlanner",),
    "moe_policy.store": ("ModelFileError", "UnknownModelError", "available", "load", "load_file"),
    "moe_policy.tracking": ("Stabilised", "Stabiliser", "TrackingPolicy"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted(["Episodes", "environments", "rollout", *_MODULE_OF])


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
