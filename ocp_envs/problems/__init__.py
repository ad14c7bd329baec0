"""The catalogue: the problems of the benchmark by their names, and those that a user adds."""

from __future__ import annotations

import copyreg

import gymnasium as gym

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems.arm import TWO_LINK_ARM
from ocp_envs.problems.cart_pole import CART_POLE
from ocp_envs.problems.discs import PLANAR_QUADCOPTER
from ocp_envs.problems.pendulum import PENDULUM
from ocp_envs.problems.quadcopter import QUADCOPTER, QUADCOPTER_OBSTACLE
from ocp_envs.problems.recovery import QUADCOPTER_RECOVERY
from ocp_envs.problems.rocket import ROCKET
from ocp_envs.problems.uncertain_pendulum import UNCERTAIN_PENDULUM
from ocp_envs.problems.vehicle import VEHICLE
from ocp_envs.support.doors import checked
from ocp_envs.support.suggestions import did_you_mean

#: The problems of Tang & Hauser, on which reinforcement learning is compared, too.
PAPER: tuple[OptimalControlProblem, ...] = (PENDULUM, VEHICLE, QUADCOPTER, QUADCOPTER_OBSTACLE)
#: All problems that ship with data and planners.
BENCHMARK: tuple[OptimalControlProblem, ...] = (
    *PAPER,
    UNCERTAIN_PENDULUM,
    CART_POLE,
    ROCKET,
    TWO_LINK_ARM,
    PLANAR_QUADCOPTER,
    QUADCOPTER_RECOVERY,
)
#: A problem, or the name of a registered one.
ProblemOrId = OptimalControlProblem | str
_catalogue: dict[str, OptimalControlProblem] = {problem.id: problem for problem in BENCHMARK}


class UnknownProblemError(KeyError):
    """No problem of that name is known."""

    def __str__(self) -> str:
        return str(self.args[0])


def _reduced(problem: OptimalControlProblem) -> tuple[object, ...]:
    """How ``problem`` is pickled: one of the benchmark by its name, so that a copy is the same object."""
    return (load, (problem.id,)) if any(problem is each for each in BENCHMARK) else problem.__reduce__()


copyreg.pickle(OptimalControlProblem, _reduced)  # type: ignore[arg-type]


class ProblemName(str):
    """The id of a registered problem, which takes the problem along to other processes."""

    def __reduce__(self) -> tuple[object, ...]:
        problem = _catalogue.get(self)
        return (ProblemName, (str(self),)) if problem is None or problem in BENCHMARK else (_arrived, (problem,))

    def __deepcopy__(self, memo: dict[int, object]) -> ProblemName:
        return self


def _arrived(problem: OptimalControlProblem) -> ProblemName:
    """The name of a ``problem`` from another process, registered here if its id is not yet known."""
    if problem.id not in _catalogue:
        register(problem)
    return ProblemName(problem.id)


@checked
def load(name: str) -> OptimalControlProblem:
    """The problem called ``name``, for instance ``"PendulumSwingup-v0"``.

    Raises:
        UnknownProblemError: no such problem; the message names the nearest one, and says how to add one.
    """
    try:
        return _catalogue[name]
    except KeyError:
        raise UnknownProblemError(
            f"unknown problem {name!r}; {did_you_mean(name, _catalogue)}known are {sorted(_catalogue)}; "
            "add yours with ocp_envs.register(problem)"
        ) from None


def problem_of(problem: ProblemOrId) -> OptimalControlProblem:
    """``problem`` itself, or the registered problem of that name.

    Raises:
        TypeError: neither a problem nor a name.
        UnknownProblemError: no problem of that name.
    """
    if isinstance(problem, OptimalControlProblem):
        return problem
    if not isinstance(problem, str):
        got = type(problem).__name__
        raise TypeError(f"expected a problem or the name of one, such as {PENDULUM.id!r}, got a {got}")
    return load(problem)


def names() -> list[str]:
    """Names of all known problems, sorted."""
    return sorted(_catalogue)


@checked
def register(problem: OptimalControlProblem, *, replace: bool = False) -> None:
    """Make ``problem`` known to :func:`load`, ``gymnasium.make`` and ``gymnasium.make_vec`` under its id.

    Registering the same object again changes nothing. A process that starts anew ("spawn") does not know the problem
    by its id, but gets it with the specification: make environments there with ``gymnasium.make(spec)``, where
    ``spec = gymnasium.spec(problem.id)``. Gymnasium's asynchronous vector environments do so by themselves.

    Args:
        problem: the problem.
        replace: take the place of another problem of that id, such as an earlier version in a notebook. Environments
            and databases that were made of the earlier one keep it. A problem of the benchmark is never replaced.

    Raises:
        ValueError: another problem, or another package's environment, already has that id.
    """
    entry_point = "ocp_envs.envs.env:Env"
    if problem.id in gym.registry and gym.registry[problem.id].entry_point != entry_point:
        raise ValueError(f"Gymnasium already has an environment {problem.id!r}; give your problem another id")
    known = _catalogue.get(problem.id, problem)
    if known is not problem and (known in BENCHMARK or not replace):
        cure = "" if known in BENCHMARK else ", or replace=True in place of the earlier one"
        raise ValueError(f"a problem called {problem.id!r} is already registered; give yours another id{cure}")
    _catalogue[problem.id] = problem
    if problem.id not in gym.registry:
        gym.register(
            id=problem.id,
            entry_point=entry_point,
            vector_entry_point="ocp_envs.envs.vector_env:VectorEnv",
            max_episode_steps=None,  # the time limit is the environment's own, in seconds
            kwargs={"problem": ProblemName(problem.id)},
        )
