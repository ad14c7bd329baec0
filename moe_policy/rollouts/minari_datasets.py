"""Episodes as datasets of Minari (Farama Foundation), for whoever learns from demonstrations.

A dataset has observations, actions and rewards of single environments as Gymnasium makes them, so that
``dataset.recover_environment()`` and the options of an episode repeat it exactly. Minari comes with the extra
``minari``; its folder is that of the environment variable ``MINARI_DATASETS_PATH``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from moe_policy.control.policy import act
from moe_policy.protocols import PlanningPolicy, Policy
from ocp_envs.problems import ProblemOrId, problem_of, register
from ocp_envs.support.arrays import Array, Ints, read_only
from ocp_envs.support.doors import checked


def _minari() -> ModuleType:
    try:
        import h5py  # noqa: F401 (Minari needs it, and says so late)
        import minari
    except ImportError as error:
        raise ImportError('datasets need Minari; install it with: pip install "ocp-moe[minari]"') from error
    found: ModuleType = minari
    return found


@checked
def export_minari(
    problem: ProblemOrId,
    policy: Policy,
    parameters: ArrayLike,
    dataset_id: str,
    *,
    dt: float = 0.02,
    disturbance: ArrayLike = 0.0,
    seed: int = 0,
) -> Any:
    """Fly ``policy`` from ``parameters`` (B, np) and keep the episodes, up to the goal ball, as a new dataset.

    Args:
        problem: the problem, which is registered if it is not.
        policy: as in :func:`moe_policy.rollout`; it acts in the single precision of the environment's action space.
        parameters: of the episodes.
        dataset_id: of the dataset, such as ``"ocp/PendulumSwingup/optimal-v0"``: words, and a version.
        dt: control period, seconds.
        disturbance: standard deviation of a normal term added to ẋ, as the environment takes it; a number or (nx,).
        seed: of the disturbance in the first episode; the i-th after it has ``seed + i``.

    Returns:
        the ``minari.MinariDataset``.

    Raises:
        ImportError: Minari is not installed.
        ValueError: Minari has a dataset of that id, it is no id, or the parameters do not fit the problem.
    """
    if not re.fullmatch(r"([\w-]+/)*[\w-]+-v\d+", dataset_id):
        raise ValueError(f'dataset_id: expected words and a version, such as "ocp/mine-v0", got {dataset_id!r}')
    minari, problem = _minari(), problem_of(problem)
    register(problem)
    p = problem.check_parameters(parameters, extrapolate=True)
    env = gym.make(problem.id, dt=dt, disturbance=np.asarray(disturbance, dtype=np.float64).tolist())
    episodes = [_episode(env, policy, row, i, seed + i) for i, row in enumerate(p)]
    described = f"Episodes of {problem.id} up to the goal ball: {problem.title}."
    return minari.create_dataset_from_buffers(
        dataset_id,
        episodes,
        env=env,
        eval_env=env,
        algorithm_name=type(policy).__name__,
        description=described,
        requirements=["ocp-moe"],
        data_format="hdf5",
    )


def _episode(env: gym.Env[Any, Any], policy: Policy, p: Array, number: int, seed: int) -> Any:
    """The buffer of one episode from ``p`` (np,), the ``number``-th, in the environment with a ``seed``."""
    from minari.data_collector import EpisodeBuffer

    options = {"parameters": p.tolist(), "extrapolate": True}
    observation, _ = env.reset(seed=seed, options=options)
    state = policy.start(p[None]) if isinstance(policy, PlanningPolicy) else None
    begins, over = np.full(1, state is None), False
    observations, actions, rewards, ends = [observation], [], [], []
    while not over:
        action, state = act(policy, observation[None], state, begins)
        actions.append(np.asarray(action[0], dtype=np.float32))
        observation, reward, terminated, truncated, _ = env.step(actions[-1])
        observations.append(observation)
        rewards.append(float(reward))
        ends.append((terminated, truncated))
        begins, over = np.zeros(1, dtype=bool), terminated or truncated
    return EpisodeBuffer(
        id=number,
        seed=seed,
        options=options,
        observations=observations,
        actions=actions,
        rewards=rewards,
        terminations=[terminated for terminated, _ in ends],
        truncations=[truncated for _, truncated in ends],
    )


@checked
@dataclass(frozen=True, eq=False)
class Transitions:
    """The decisions of a dataset, one after another.

    Args:
        observations: before each decision, (n, nx + nc).
        actions: of each decision, (n, nu).
        episodes: number of the episode of each decision, (n,).

    The arrays are read-only; other shapes raise a ``ValueError``.
    """

    observations: Array
    actions: Array
    episodes: Ints

    def __post_init__(self) -> None:
        for name, kind in (("observations", np.float64), ("actions", np.float64), ("episodes", np.int64)):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name), dtype=kind)))
        shapes = self.observations.shape, self.actions.shape, self.episodes.shape
        if [len(shape) for shape in shapes] != [2, 2, 1] or len({shape[0] for shape in shapes}) != 1:
            raise ValueError(f"expected observations (n, nx + nc), actions (n, nu), episodes (n,); got {shapes}")


def read_minari(dataset: Any) -> Transitions:
    """The decisions of a ``dataset``, a ``minari.MinariDataset`` or the id of one that is on this machine.

    Raises:
        ImportError: Minari is not installed.
        TypeError: neither a dataset nor an id.
        FileNotFoundError: no dataset of that id.
    """
    found = list(_opened(dataset).iterate_episodes())
    return Transitions(
        np.concatenate([episode.observations[:-1] for episode in found]).astype(np.float64),
        np.concatenate([episode.actions for episode in found]).astype(np.float64),
        np.repeat(np.arange(len(found)), [len(episode.actions) for episode in found]),
    )


def _opened(dataset: Any) -> Any:
    """A ``dataset``, or that of an id."""
    minari = _minari()
    if isinstance(dataset, minari.MinariDataset):
        return dataset
    if not isinstance(dataset, str):
        raise TypeError(f"dataset: expected a minari.MinariDataset or the id of one, got a {type(dataset).__name__}")
    return minari.load_dataset(dataset)


def resimulate(dataset: Any, problem: ProblemOrId) -> float:
    """The largest difference between what a dataset holds and the same actions in its environment.

    Observations are compared in units of the scales of the problem, and rewards as they are.

    Args:
        dataset: a ``minari.MinariDataset`` made by :func:`export_minari`, or its id.
        problem: the problem, or the id of a registered one.

    Raises:
        ImportError: Minari is not installed.
        TypeError: neither a dataset nor an id.
        FileNotFoundError: no dataset of that id.
        ValueError: a dataset of another problem.
    """
    dataset, problem = _opened(dataset), problem_of(problem)
    env, worst = dataset.recover_environment(), 0.0
    if env.spec.id != problem.id:
        raise ValueError(f"dataset: it is of {env.spec.id}, expected one of {problem.id}")
    scale = np.concatenate([problem.system.state.scale, np.ones(len(problem.context))])
    told = dataset.storage.get_episode_metadata(dataset.episode_indices)
    for episode, metadata in zip(dataset.iterate_episodes(), told):
        parameters = np.asarray(metadata["options"]["parameters"])
        options = {"parameters": parameters, "extrapolate": True}
        observation, _ = env.reset(seed=int(metadata["seed"]), options=options)
        difference = [np.abs(observation - episode.observations[0]) / scale]
        for action, following, reward in zip(episode.actions, episode.observations[1:], episode.rewards):
            observation, got, *_ = env.step(action)
            difference += [np.abs(observation - following) / scale, np.abs([got - reward])]
        worst = max(worst, *(float(each.max()) for each in difference))
    return worst
