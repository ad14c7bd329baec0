"""How methods do on plants that differ from the model (:mod:`moe_policy.experiments.perturbations`), level by level.

Planners and policies know the nominal problem only. Every level is a set of arguments of the environments
(:class:`ocp_envs.Env`), so all run through the common loop.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from moe_policy.experiments.methods import Method
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.metrics import evaluate
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array

#: What is kept of the metrics of a level.
FIGURES = ("reached", "success", "success_at_plan_end", "left_box", "violation_mean", "knot_violation_mean")


def level_key(identity: str, arguments: Mapping[str, Any]) -> str:
    """A short name for what a level's figures depend on.

    Args:
        identity: names all but the plant: problem, methods, starts, seed and control period.
        arguments: of the environment. The nominal plants of all perturbations are one level.
    """
    told = json.dumps([identity, arguments], sort_keys=True, default=lambda values: values.tolist())
    return hashlib.sha256(told.encode()).hexdigest()[:16]


def run_level(
    problem: OptimalControlProblem,
    methods: Sequence[Method],
    starts: Array,
    arguments: Mapping[str, Any],
    *,
    seed: int = 0,
    dt: float = 0.02,
) -> list[dict[str, Any]]:
    """How each method does from ``starts`` (B, np) on one plant: its name and :data:`FIGURES`, a record each.

    Args:
        problem: the nominal problem, which planners plan for.
        methods: who acts; names must differ.
        starts: parameters of the episodes.
        arguments: of :meth:`~moe_policy.experiments.perturbations.Perturbation.arguments`.
        seed: of noise and disturbances. They are drawn for each episode by itself, so that the same episode meets the
            same draws whoever acts, and at another level the same ones times another factor.
        dt: control period, seconds.
    """
    rows = []
    for method in methods:
        envs = environments(problem, len(starts), dt, **arguments)
        envs.reset(seed=seed)  # rollout itself does not seed
        metrics = evaluate(problem, rollout(envs, method.policy(problem, dt), starts)).record()
        envs.close()
        rows.append({"name": method.name} | {key: metrics[key] for key in FIGURES})
    return rows
