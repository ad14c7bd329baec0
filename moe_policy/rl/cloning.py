"""Behaviour cloning: a network that imitates the tracked optimum, without reinforcement.

The demonstrations are episodes of the stored optimal trajectories of a problem, tracked by LQR at the learner's own
period, up to the goal ball. The network learns the action of each decision from the features of its state, by least
squares over single decisions. It does not see where its own actions lead (compare Pomerleau, *Efficient training of
artificial neural networks for autonomous navigation*, 1991).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.rl.actor import Actor, LearnedPolicy
from moe_policy.rl.common import LearnerSettings
from moe_policy.rl.encoding import actions_of, features_of
from moe_policy.rl.evaluation import Evaluator
from moe_policy.rl.features import Float32
from moe_policy.rl.training import TrainingRun
from moe_policy.rollouts.environments import environments
from moe_policy.rollouts.rollout import rollout
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.arrays import Array
from ocp_envs.support.doors import checked


@checked
@dataclass(frozen=True, kw_only=True)
class CloningSettings(LearnerSettings):
    """Behaviour cloning of the tracked optimum; ``steps`` is the largest number of decisions that are imitated.

    Of the common settings, ``period``, ``hidden``, ``batch_size`` and ``final_learning_rate`` have defaults of their
    own.

    Args:
        epochs: passes over the decisions.
        disturbance: standard deviation of the disturbance under which the demonstrations are flown, of each coordinate
            in units of its scale over a second; 0 for none.
        flights: how often each stored trajectory is flown, each time under another disturbance.
    """

    algorithm: ClassVar[str] = "bc"

    steps: int = 1_000_000
    period: float = 0.04
    hidden: tuple[int, ...] = (128, 128)
    batch_size: int = 1024
    final_learning_rate: float = 0.0
    epochs: int = 50
    disturbance: float = 0.0
    flights: int = 1

    def complete(self, steps: int) -> bool:
        """Always: there are no more demonstrations than ``steps``."""
        return True


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """Decisions of the tracked optimum: ``observations`` (n, nx + nc) and ``controls`` (n, nu) of ``episodes``."""

    observations: Array
    controls: Array
    episodes: int


def demonstrations(problem: OptimalControlProblem, settings: CloningSettings, stored: NearestPlanner) -> Demonstrations:
    """Tracked episodes of ``stored`` optimal trajectories of ``problem``, at most ``settings.steps`` decisions."""
    p = np.tile(stored.parameters, (settings.flights, 1))
    deviation = settings.disturbance * problem.system.state.scale
    envs = environments(problem, len(stored.parameters), settings.period, disturbance=deviation)
    envs.reset(seed=settings.seed)
    flown = rollout(envs, TrackingPolicy(problem, stored, settings.period), p, record=True)
    envs.close()
    states, controls = np.asarray(flown.states), np.asarray(flown.controls)
    count = controls.shape[1]
    over = np.where(flown.reached, flown.entry_time, flown.evaluation_time)
    decided = (np.arange(count) * settings.period < over[:, None] - settings.period / 2) & ~flown.left_box[:, None]
    decided &= np.isfinite(controls).all(axis=-1)
    whole = np.cumsum(decided.sum(axis=1)) <= settings.steps
    decided &= whole[:, None]
    contexts = np.repeat(problem.start(p)[1][:, None], count, axis=1)
    observations = np.concatenate([states[:, :-1], contexts], axis=-1)[decided]
    return Demonstrations(observations, controls[decided], int(decided.any(axis=1).sum()))


def fitted(features: Float32, actions: Float32, settings: CloningSettings) -> Actor:
    """The actor that imitates ``actions`` (n, nu) at ``features`` (n, m), trained with ``settings``."""
    torch.manual_seed(settings.seed)
    sizes = (features.shape[1], *settings.hidden, actions.shape[1])
    layers = [nn.Linear(inputs, outputs) for inputs, outputs in pairwise(sizes)]
    parts: list[nn.Module] = [part for layer in layers[:-1] for part in (layer, nn.Tanh())]
    network = nn.Sequential(*parts, layers[-1])
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    x, y = torch.from_numpy(features), torch.from_numpy(actions)
    batches = -(-len(x) // settings.batch_size)
    for epoch in range(settings.epochs):
        for k, rows in enumerate(torch.randperm(len(x)).split(settings.batch_size)):
            done = (epoch + k / batches) / settings.epochs
            optimiser.param_groups[0]["lr"] = settings.rate(1 - done)
            optimiser.zero_grad()
            nn.functional.mse_loss(network(x[rows]), y[rows]).backward()
            optimiser.step()
    return Actor.of_layers(layers, "tanh", "clip")


@checked
def clone(
    problem: ProblemOrId,
    settings: CloningSettings,
    stored: NearestPlanner,
    development: ArrayLike,
    *,
    optimal_costs: ArrayLike | None = None,
    details: Mapping[str, object] | None = None,
) -> TrainingRun:
    """Train a policy that imitates tracked optimal trajectories, and evaluate it once, at the end.

    Args:
        problem: the problem.
        settings: of the cloning.
        stored: the optimal trajectories.
        development: parameters (B, np) on which the policy is evaluated.
        optimal_costs: the best known cost from each of them, (B,), for cost ratios.
        details: kept with the policy, as JSON.

    Raises:
        ValueError: parameters outside their box, or optimal costs that are not B positive numbers.
    """
    problem = problem_of(problem)
    evaluator, encoding = Evaluator(problem, development, optimal_costs), settings.encoding(problem)
    shown = demonstrations(problem, settings, stored)
    actions = np.clip(actions_of(problem, encoding).actions(shown.controls), -1, 1).astype(np.float32)
    actor, steps = fitted(features_of(problem, encoding)(shown.observations), actions, settings), len(actions)
    policy = LearnedPolicy(
        problem,
        actor,
        period=settings.period,
        algorithm=settings.algorithm,
        details={**(details or {}), "steps": steps, "episodes": shown.episodes, "settings": asdict(settings)},
        encoding=encoding,
    )
    evaluation = evaluator(policy, steps)
    evaluator.close()
    return TrainingRun(settings, policy, evaluation, (evaluation,))
