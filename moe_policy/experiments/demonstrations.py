"""Datasets of optimal episodes in Minari's format, how exactly they can be simulated again, and clones of them."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column, duration, proportion
from moe_policy.rl.actor import LearnedPolicy
from moe_policy.rl.cloning import CloningSettings, fitted
from moe_policy.rl.encoding import actions_of, features_of
from moe_policy.rollouts.metrics import Metrics, evaluate
from moe_policy.rollouts.minari_datasets import Transitions, export_minari, read_minari, resimulate
from moe_policy.score.method import Method
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets import reference
from ocp_envs.support.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class DatasetRow(Record):
    """One dataset."""

    env_id: str  # id of the environment
    dataset: str  # id of the dataset
    episodes: int  # number of episodes
    steps: int  # number of control steps
    reached: int  # episodes that end in the goal ball
    mean_return: float  # sum of rewards of an episode
    megabytes: float  # size of its files
    difference: float  # largest one when its actions are simulated again, in scales of the state and units of reward


@dataclass(frozen=True, kw_only=True)
class CloneRow(Record):
    """A policy that was cloned from a dataset alone, on the validation set."""

    env_id: str  # id of the environment
    dataset: str  # id of the dataset
    disturbance: float  # standard deviation of that under which its episodes were flown, in scales of the state
    dt: float  # control period, seconds
    episodes: int  # number of episodes
    decisions: int  # number of decisions that are imitated
    seconds: float  # duration of the training
    settings: dict[str, Any]  # of the training
    metrics: Metrics  # on the validation set, without a disturbance


@dataclass(frozen=True, kw_only=True)
class Datasets(Record):
    """The tracked optimum's episodes of every environment, and clones: ``minari.json``."""

    dt: float  # control period of the episodes of ``rows``, seconds
    rows: tuple[DatasetRow, ...]  # one for each environment
    clones: tuple[CloneRow, ...]  # policies that learnt from datasets
    provenance: Provenance  # of the record


def dataset_row(problem: OptimalControlProblem, stored: NearestPlanner, cases: int, dt: float) -> DatasetRow:
    """Make the dataset of the first ``cases`` trajectories of ``stored``, tracked, and simulate it again."""
    name = f"ocp/{problem.id.rpartition('-v')[0]}/optimal-v0"
    dataset = export_minari(problem, TrackingPolicy(problem, stored, dt), stored.parameters[:cases], name, dt=dt)
    episodes = list(dataset.iterate_episodes())
    return DatasetRow(
        env_id=problem.id,
        dataset=name,
        episodes=len(episodes),
        steps=int(dataset.total_steps),
        reached=sum(bool(episode.terminations[-1]) and _ends_at_goal(problem, episode) for episode in episodes),
        mean_return=float(np.mean([episode.rewards.sum() for episode in episodes])),
        megabytes=round(float(dataset.storage.get_size()), 3),
        difference=resimulate(dataset, problem),
    )


def clone_row(
    problem: OptimalControlProblem, stored: NearestPlanner, settings: CloningSettings, cases: int, dt: float
) -> CloneRow:
    """Clone the tracked optimum from a dataset of the first ``cases`` trajectories of ``stored``; evaluate the clone.

    The episodes have the control period and the disturbance of the ``settings``; those of the evaluation have the
    period ``dt``, seconds.
    """
    flown = "disturbed" if settings.disturbance else "undisturbed"
    name = f"ocp/{problem.id.rpartition('-v')[0]}/{flown}-v0"
    policy = TrackingPolicy(problem, stored, settings.period)
    disturbance = settings.disturbance * problem.system.state.scale
    export_minari(problem, policy, stored.parameters[:cases], name, dt=settings.period, disturbance=disturbance)
    decisions, began = read_minari(name), time.perf_counter()
    clone = _clone(problem, decisions, settings)
    seconds = time.perf_counter() - began
    validation = reference.load(problem, "validation").parameters
    return CloneRow(
        env_id=problem.id,
        dataset=name,
        disturbance=settings.disturbance,
        dt=settings.period,
        episodes=len(np.unique(decisions.episodes)),
        decisions=len(decisions.actions),
        seconds=seconds,
        settings=asdict(settings),
        metrics=evaluate(problem, Method("bc", clone).fly(problem, validation, dt)),
    )


def _clone(problem: OptimalControlProblem, decisions: Transitions, settings: CloningSettings) -> LearnedPolicy:
    """A policy that imitates ``decisions``, trained with ``settings``."""
    encoding = settings.encoding(problem)
    actions = np.clip(actions_of(problem, encoding).actions(decisions.actions), -1, 1).astype(np.float32)
    actor = fitted(features_of(problem, encoding)(decisions.observations), actions, settings)
    return LearnedPolicy(problem, actor, period=settings.period, algorithm=settings.algorithm, encoding=encoding)


def _ends_at_goal(problem: OptimalControlProblem, episode: object) -> bool:
    last = np.asarray(episode.observations[-1:], dtype=np.float64)  # type: ignore[attr-defined]
    nx = problem.system.nx
    return bool(problem.goal_error(last[:, :nx], last[:, nx:])[0] < problem.goal.radius * (1 + 1e-5))


DATASET_COLUMNS: tuple[Column[DatasetRow], ...] = (
    Column("environment", lambda row: row.env_id),
    Column("dataset", lambda row: row.dataset),
    Column("episodes", lambda row: row.episodes, ","),
    Column("control steps", lambda row: row.steps, ","),
    Column("at the goal", lambda row: row.reached, ","),
    Column("mean return", lambda row: row.mean_return, ".2f"),
    Column("MB", lambda row: row.megabytes, ".1f"),
    Column("largest difference, simulated again", lambda row: row.difference, ".1g"),
)
CLONE_COLUMNS: tuple[Column[CloneRow], ...] = (
    Column("dataset", lambda row: row.dataset),
    Column("disturbance of its episodes", lambda row: row.disturbance or "none"),
    Column("episodes", lambda row: row.episodes, ","),
    Column("decisions", lambda row: row.decisions, ","),
    Column("success of the clone (95 %)", lambda row: row.metrics.success, proportion),
    Column("median error at the end", lambda row: row.metrics.final_error_median, ".2g"),
    Column("training", lambda row: row.seconds, duration),
)
