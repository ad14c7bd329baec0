"""Which parameters every problem is trained, tuned and judged on, and which hard sets it is tried on beside them.

The seeds of all sets of a problem differ, so that no two share a parameter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import EqualCosts, SphereCentre, discontinuity_of
from ocp_envs.sets.hard_sets import AROUND, HardSet, NearCentre, NearJump, OutsideBox
from ocp_envs.sets.sampling import grid, sample
from ocp_envs.support.arrays import Array
from ocp_envs.support.suggestions import did_you_mean


@dataclass(frozen=True)
class Split:
    """A set of parameters.

    Args:
        size: number of parameters, drawn at random; ignored for a grid. A smaller set with the same seed is the
            beginning of a larger one.
        seed: of the draw, and of the generation.
        grid: points along each coordinate of p, for a grid over the box.
        settings: how its database is made.
    """

    size: int = 0
    seed: int = 0
    grid: tuple[int, ...] | None = None
    settings: GenerationSettings = DEFAULT_GENERATION

    def __len__(self) -> int:
        return self.size if self.grid is None else math.prod(self.grid)

    def parameters(self, problem: OptimalControlProblem, first: int | None = None) -> Array:
        """The parameters, (M, np), or the ``first`` of them."""
        if self.grid is not None:
            return grid(problem, self.grid)[:first]
        return sample(problem, self.seed, self.size if first is None else min(first, self.size), workers=None)


#: A quadcopter has one optimum, and a sphere in space does not separate paths: nearly all starts end in the same one.
#: So few solves are spent: from a fit through neighbours, and from lines only, as fatrop hangs on the motions under
#: random controls.
_ONE_OPTIMUM = GenerationSettings(starts=2, neighbours=1, lookaround=1, guess="line", fit=40)
#: The vehicle's settings are chosen from results/benchmark_generation_GroundVehicle-v0.json: on 2,000 problems a margin
#: of 0.1 misses as many optima as 0.3 does with two thirds of the solves, and three neighbours miss none.
_TRAINING = {
    "PendulumSwingup-v0": Split(grid=(61, 21)),
    "GroundVehicle-v0": Split(size=120_009, seed=10, settings=GenerationSettings(margin=0.1)),
    "Quadcopter-v0": Split(size=9_000, seed=10, settings=_ONE_OPTIMUM),
    "QuadcopterObstacle-v0": Split(size=616_758, seed=10, settings=_ONE_OPTIMUM),
}
_OTHERS = {
    "development": Split(size=1_000, seed=101, settings=GenerationSettings.thorough()),
    "validation": Split(size=1_000, seed=202, settings=GenerationSettings.thorough()),
}
_VEHICLE = GenerationSettings(neighbours=3)
_CHECKED = GenerationSettings(starts=3, neighbours=1, lookaround=4, cold=1, guess="line", fit=40)
_OF_THEIR_OWN = {
    "Quadcopter-v0": {
        "development": Split(size=1_000, seed=101, settings=_CHECKED),
        "validation": Split(size=1_000, seed=202, settings=_CHECKED),
    },
    "QuadcopterObstacle-v0": {
        "development": Split(size=1_000, seed=101, settings=_CHECKED),
        "validation": Split(size=10_000, seed=202, settings=_CHECKED),
    },
    "GroundVehicle-v0": {
        "development": Split(size=1_000, seed=101, settings=_VEHICLE),
        "validation": Split(size=10_000, seed=202, settings=_VEHICLE),
    },
}


def splits_of(problem: OptimalControlProblem) -> dict[str, Split]:
    """The splits of ``problem`` by name; a problem of one's own gets 10,000 random training parameters."""
    training = _TRAINING.get(problem.id, Split(size=10_000, seed=10))
    return {"training": training, **_OTHERS, **_OF_THEIR_OWN.get(problem.id, {})}


def split_of(problem: OptimalControlProblem, name: str) -> Split:
    """The split called ``name``.

    Raises:
        ValueError: no such split; the message names the nearest one.
    """
    splits = splits_of(problem)
    if name not in splits:
        raise ValueError(_no_such("split", name, splits, problem))
    return splits[name]


def _no_such(kind: str, name: str, names: Iterable[str], problem: OptimalControlProblem) -> str:
    return f"{problem.id} has no {kind} {name!r}; {did_you_mean(name, names)}there are {sorted(names)}"


# -- hard sets ---------------------------------------------------------------------------------------------------------

_NEAR, _OUTSIDE = 505, 606
#: Quadcopters have one optimum nearly everywhere.
_FEW = replace(AROUND, starts=6)
_HARD: dict[str, dict[str, HardSet]] = {
    # One in seventy of the pendulum's box is within 3 % of the jump, one in eight of the vehicle's.
    "PendulumSwingup-v0": {"boundary": NearJump(_NEAR, 40_000), "outside": OutsideBox(_OUTSIDE, (0.0, 0.25))},
    "GroundVehicle-v0": {"boundary": NearJump(_NEAR, 5_000)},
    "Quadcopter-v0": {"outside": OutsideBox(_OUTSIDE, settings=_FEW)},
    "QuadcopterObstacle-v0": {"outside": OutsideBox(_OUTSIDE, settings=_FEW)},
}


def hard_sets_of(problem: OptimalControlProblem) -> dict[str, HardSet]:
    """The hard sets of ``problem`` by name: ``outside``, and where its optimum jumps ``boundary``."""
    near: dict[str, HardSet] = {}
    match discontinuity_of(problem):
        case SphereCentre():
            near = {"boundary": NearCentre(_NEAR)}
        case EqualCosts():
            near = {"boundary": NearJump(_NEAR, 20_000)}
    return {**near, "outside": OutsideBox(_OUTSIDE), **_HARD.get(problem.id, {})}


def hard_set_of(problem: OptimalControlProblem, name: str) -> HardSet:
    """The hard set called ``name``.

    Raises:
        ValueError: no such set; the message names the nearest one.
    """
    sets = hard_sets_of(problem)
    if name not in sets:
        raise ValueError(_no_such("hard set", name, sets, problem))
    return sets[name]
