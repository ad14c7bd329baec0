"""Training of the reinforcement learning baselines: learners of Stable-Baselines3 on the environments of ``ocp_envs``.

The learner observes features and acts in [-1, 1] (:mod:`moe_policy.rl.encoding`), at its own control period, in
episodes that end in the goal ball. The reward is −∫L dt of a step, so the undiscounted return is the cost that the
planners minimise. The actor is evaluated at regular intervals (:mod:`moe_policy.rl.evaluation`) and the best one is
kept.

Only :func:`train` needs Stable-Baselines3; trained policies run without it (:mod:`moe_policy.rl.actor`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.common import LearnerSettings, RLSettings
from moe_policy.rl.curriculum import VectorNearStarts, VectorShrinkingGoal, with_moving_starts
from moe_policy.rl.encoding import actions_of, features_of
from moe_policy.rl.evaluation import Evaluation, Evaluator
from moe_policy.rl.settings import PPOSettings
from moe_policy.rl.wrappers import (
    Environments,
    VectorFeatureObservation,
    VectorNormalisedAction,
    VectorShapedReward,
)
from moe_policy.rollouts.environments import environments
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import ProblemOrId, problem_of
from ocp_envs.support.doors import checked

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from moe_policy.rl.vec_env import SB3VecEnv


@checked
@dataclass(frozen=True, eq=False)
class TrainingRun:
    """A training with ``settings`` up to an evaluation: the ``best`` in the ``curve`` of them, and its ``policy``."""

    settings: LearnerSettings
    policy: LearnedPolicy
    best: Evaluation
    curve: tuple[Evaluation, ...] = ()


def training_env(problem: OptimalControlProblem, settings: RLSettings) -> SB3VecEnv:
    """``problem`` as a learner with ``settings`` sees it: features, actions in [-1, 1], one decision a step."""
    try:
        from moe_policy.rl.vec_env import SB3VecEnv
    except ImportError as error:
        raise ImportError(f"training needs Stable-Baselines3: pip install 'ocp-moe[rl]' ({error})") from error

    begun = with_moving_starts(problem) if settings.moving_starts else problem
    envs: Environments = environments(begun, settings.n_envs, settings.period, terminate_at_goal=True)
    if settings.near_starts:
        envs = VectorNearStarts(
            envs, settings.near_starts, settings.seed, settings.moving_starts, problem, settings.nearness
        )
    if settings.first_radius:
        envs = VectorShrinkingGoal(envs, settings.first_radius)
    encoding = settings.encoding(problem)
    seen = VectorFeatureObservation(VectorShapedReward(envs, settings), features_of(problem, encoding))
    return SB3VecEnv(VectorNormalisedAction(seen, actions_of(problem, encoding)))


@dataclass(eq=False)
class _Progress:
    """A training under way: it evaluates the learner when an evaluation is due, and keeps the best policy."""

    learner: BaseAlgorithm
    settings: RLSettings
    evaluator: Evaluator
    details: Mapping[str, object]
    on_evaluation: Callable[[TrainingRun], None] | None
    run: TrainingRun | None = None

    @property
    def evaluated(self) -> int:
        """Steps at the last evaluation."""
        return self.run.curve[-1].steps if self.run else 0

    def after_step(self, local: dict[str, object], world: dict[str, object]) -> bool:
        """Callback of Stable-Baselines3: evaluate where ``evaluate_every`` steps are complete, and continue."""
        self.settings.after_step(self.learner)
        every = self.settings.evaluate_every
        if self.learner.num_timesteps // every > self.evaluated // every:
            self.evaluate()
        return True

    def evaluate(self) -> TrainingRun:
        """Evaluate the current actor and report."""
        steps, settings = self.learner.num_timesteps, self.settings
        details = {**self.details, "steps": steps, "settings": asdict(settings)}
        policy = LearnedPolicy(
            self.evaluator.problem,
            settings.actor(self.learner),
            period=settings.period,
            algorithm=settings.algorithm,
            details=details,
            encoding=settings.encoding(self.evaluator.problem),
        )
        evaluation, run = self.evaluator(policy, steps), self.run
        if run is None:
            run = TrainingRun(settings, policy, evaluation)
        elif evaluation.better_than(run.best):
            run = replace(run, policy=policy, best=evaluation)
        self.run = replace(run, curve=(*run.curve, evaluation))
        if self.on_evaluation is not None:
            self.on_evaluation(self.run)
        return self.run

    def complete(self) -> TrainingRun:
        """The run with an evaluation of the last step."""
        if self.run is None or self.evaluated < self.learner.num_timesteps:
            return self.evaluate()
        return self.run


@checked
def train(
    problem: ProblemOrId,
    settings: RLSettings,
    development: ArrayLike,
    *,
    optimal_costs: ArrayLike | None = None,
    on_evaluation: Callable[[TrainingRun], None] | None = None,
    details: Mapping[str, object] | None = None,
    begin: LearnedPolicy | None = None,
) -> TrainingRun:
    """Train a policy and keep the best by development score.

    Args:
        problem: the problem.
        settings: of the learner, such as :class:`~moe_policy.rl.settings.SACSettings`.
        development: parameters (B, np) on which the best actor is chosen.
        optimal_costs: the best known cost from each of them, (B,), for cost ratios; they do not affect the choice.
        on_evaluation: called with the run so far after each evaluation, to report and to save.
        details: kept with the policy, as JSON.
        begin: a policy whose actor PPO begins with, such as a cloned one, of the same layers and encoding.

    Raises:
        ImportError: Stable-Baselines3 is not installed.
        TypeError: a policy to begin with, for another learner than PPO.
        ValueError: a policy to begin with that does not fit, parameters outside their box, or optimal costs that are
            not B positive numbers.
    """
    problem = problem_of(problem)
    evaluator = Evaluator(problem, development, optimal_costs)
    env = training_env(problem, settings)
    learner = settings.learner(env)
    if begin is not None:
        if not isinstance(settings, PPOSettings):
            raise TypeError(f"begin: expected settings of PPO with it, got {type(settings).__name__}")
        settings.begin_with(learner, begin.actor)
    progress = _Progress(learner, settings, evaluator, details or {}, on_evaluation)
    learner.learn(settings.steps, callback=progress.after_step)
    run = progress.complete()
    env.close()
    evaluator.close()
    return run
