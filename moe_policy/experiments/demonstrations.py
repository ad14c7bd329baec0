"""Datasets of optimal episodes in Minari's format, and how exactly they can be simulated again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moe_policy.control.tracking import TrackingPolicy
from moe_policy.planners.nearest import NearestPlanner
from moe_policy.reports.records import Record
from moe_policy.reports.tables import Column
from moe_policy.rollouts.minari_datasets import export_minari, resimulate
from ocp_envs.problem import OptimalControlProblem
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
class Datasets(Record):
    """The tracked optimum's episodes of every environment: ``minari.json``."""

    dt: float  # control period, seconds
    rows: tuple[DatasetRow, ...]  # one for each environment
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
