"""The sets of instances that belong to a problem: for training, development and validation, and the hard ones.

All sets of a problem have different seeds, so that no two share a parameter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

from ocp_envs.data.settings import DEFAULT_GENERATION, GenerationSettings
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.sets.discontinuity import EqualCosts, SphereCentre, discontinuity_of
from ocp_envs.sets.hard_sets import (
    AROUND,
    WITHOUT_NEIGHBOURS,
    HardSet,
    NearCentre,
    NearEqualCosts,
    NearGoal,
    OutsideBox,
)
from ocp_envs.sets.near import initial_values
from ocp_envs.sets.sampling import grid, sample
from ocp_envs.support.arrays import Array
from ocp_envs.support.suggestions import did_you_mean

T = TypeVar("T")


@dataclass(frozen=True)
class InstanceSet:
    """Instances of a problem: a random sample, or a grid.

    Args:
        size: number of instances of a random sample; ignored for a grid. A smaller sample with the same seed is the
            beginning of a larger one.
        seed: of the sample, and of the guesses of the solver.
        grid: number of points along each coordinate of p, for a grid over the parameter box.
        settings: how the database of the set is generated.
    """

    size: int = 0
    seed: int = 0
    grid: tuple[int, ...] | None = None
    settings: GenerationSettings = DEFAULT_GENERATION

    def __len__(self) -> int:
        return self.size if self.grid is None else math.prod(self.grid)

    def parameters(self, problem: OptimalControlProblem, first: int | None = None) -> Array:
        """The parameters of the set, (M, np).

        Args:
            problem: the problem.
            first: return the first so many alone.
        """
        if self.grid is not None:
            return grid(problem, self.grid)[:first]
        return sample(problem, self.seed, self.size if first is None else min(first, self.size), workers=None)


_SEEDS = {"training": 10, "development": 101, "validation": 202, "boundary": 505, "outside": 606, "near": 707}


def _training(size: int, settings: GenerationSettings = DEFAULT_GENERATION) -> InstanceSet:
    return InstanceSet(size, _SEEDS["training"], settings=settings)


def _development(settings: GenerationSettings) -> InstanceSet:
    return InstanceSet(1_000, _SEEDS["development"], settings=settings)


def _validation(size: int, settings: GenerationSettings) -> InstanceSet:
    return InstanceSet(size, _SEEDS["validation"], settings=settings)


_TRAINING = _training(10_000)
_DEVELOPMENT = _development(GenerationSettings.thorough())
_VALIDATION = _validation(1_000, GenerationSettings.thorough())
_OUTSIDE = OutsideBox(_SEEDS["outside"])
_NEAR = NearGoal(_SEEDS["near"])


@dataclass(frozen=True, kw_only=True)
class ProblemSets:
    """The sets of one problem; the defaults are those of a problem of the user.

    Args:
        training: what planners learn from.
        development: what settings are chosen on.
        validation: what results are reported on.
        boundary: instances near a discontinuity of the optimum; ``None`` where none is known.
        outside: instances outside the parameter box.
        near: instances near the goal; ``None`` where no parameter is an initial value of the state.
    """

    training: InstanceSet = _TRAINING
    development: InstanceSet = _DEVELOPMENT
    validation: InstanceSet = _VALIDATION
    boundary: HardSet | None = None
    outside: HardSet = _OUTSIDE
    near: HardSet | None = _NEAR

    @property
    def splits(self) -> dict[str, InstanceSet]:
        """The sets for training, development and validation, by name."""
        return {"training": self.training, "development": self.development, "validation": self.validation}

    @property
    def hard(self) -> dict[str, HardSet]:
        """The hard sets by name."""
        sets = {"boundary": self.boundary, "outside": self.outside, "near": self.near}
        return {name: hard for name, hard in sets.items() if hard is not None}

    def split(self, name: str) -> InstanceSet:
        """The set for training, development or validation called ``name``.

        Raises:
            ValueError: no such set; the message names the nearest one.
        """
        return _lookup("split", name, self.splits)

    def hard_set(self, name: str) -> HardSet:
        """The hard set called ``name``.

        Raises:
            ValueError: no such set; the message names the nearest one.
        """
        return _lookup("hard set", name, self.hard)


def _lookup(kind: str, name: str, sets: Mapping[str, T]) -> T:
    if name not in sets:
        raise ValueError(f"the problem has no {kind} {name!r}; {did_you_mean(name, sets)}there are {sorted(sets)}")
    return sets[name]


#: A quadcopter has one optimum, and a sphere in space does not separate paths: from nearly all guesses the solver finds
#: the same one. Few guesses therefore suffice: a fit through neighbours, and lines, since fatrop hangs on motions under
#: random controls.
_ONE_OPTIMUM = GenerationSettings(starts=2, neighbours=1, lookaround=1, guess="line", fit=40)
_CHECKED = GenerationSettings(starts=3, neighbours=1, lookaround=4, cold=1, guess="line", fit=40)
_AROUND_ONE_OPTIMUM = replace(AROUND, starts=6)
_OUTSIDE_ONE_OPTIMUM = OutsideBox(_SEEDS["outside"], settings=_AROUND_ONE_OPTIMUM)
#: Settings of the vehicle follow results/benchmark_generation_GroundVehicle-v0.json: on 2,000 instances a margin of 0.1
#: misses as many optima as 0.3 does with two thirds of the solves, and three neighbours miss none.
_VEHICLE = GenerationSettings(neighbours=3)
#: Databases that are made in minutes.
_FEW = GenerationSettings(first=100, starts=4)
_SEVERAL = GenerationSettings(first=100, starts=8, cold=1)
#: The pole swings up with any number of swings, so that one final angle has several optima, which few guesses miss.
_MANY_SWINGS = GenerationSettings(first=1500, starts=12, neighbours=4, lookaround=16, margin=0.5)
#: Three obstacles, each passed on either side, need more guesses.
_EVERY_SIDE = GenerationSettings(first=400, starts=20)
_EVERY_SIDE_OFTEN = GenerationSettings(first=200, starts=30, cold=1)
_FEW_OUTSIDE = OutsideBox(_SEEDS["outside"], size=200, settings=replace(WITHOUT_NEIGHBOURS, starts=6))
_BENCHMARK = {
    "PendulumSwingup-v0": ProblemSets(
        training=InstanceSet(grid=(61, 21)),
        # One in seventy instances in the box of the pendulum is within 3 % of the discontinuity, one in eight of the
        # vehicle.
        boundary=NearEqualCosts(_SEEDS["boundary"], 40_000),
        outside=OutsideBox(_SEEDS["outside"], (0.0, 0.25)),
    ),
    "GroundVehicle-v0": ProblemSets(
        training=_training(120_009, GenerationSettings(margin=0.1)),
        development=_development(_VEHICLE),
        validation=_validation(10_000, _VEHICLE),
        boundary=NearEqualCosts(_SEEDS["boundary"], 5_000),
        # Where one parks: at any heading and speed.
        near=NearGoal(_SEEDS["near"], coordinates=("x", "y"), size=2_000),
    ),
    "Quadcopter-v0": ProblemSets(
        training=_training(9_000, _ONE_OPTIMUM),
        development=_development(_CHECKED),
        validation=_validation(1_000, _CHECKED),
        outside=_OUTSIDE_ONE_OPTIMUM,
        near=NearGoal(_SEEDS["near"], settings=_AROUND_ONE_OPTIMUM),
    ),
    "QuadcopterObstacle-v0": ProblemSets(
        training=_training(616_758, _ONE_OPTIMUM),
        development=_development(_CHECKED),
        validation=_validation(10_000, _CHECKED),
        boundary=NearCentre(_SEEDS["boundary"]),
        outside=_OUTSIDE_ONE_OPTIMUM,
        # Flights that begin closer hardly have to bend: the free optimum enters the sphere 0.03 m deep in the median
        # with the fraction 0.15, and 0.09 m with 0.3.
        near=NearGoal(_SEEDS["near"], 0.3, size=500, settings=_AROUND_ONE_OPTIMUM),
    ),
    "PendulumUncertain-v0": ProblemSets(
        training=_training(30_000, _FEW),
        development=_development(_SEVERAL),
        validation=_validation(1_000, _SEVERAL),
        boundary=NearEqualCosts(_SEEDS["boundary"], 12_000, size=100),
        near=None,
    ),
    "CartPoleSwingup-v0": ProblemSets(
        training=_training(12_000, _MANY_SWINGS),
        development=_development(_SEVERAL),
        validation=_validation(1_000, _SEVERAL),
        boundary=NearEqualCosts(_SEEDS["boundary"], 2_000, size=90, spare=1.7, settings=WITHOUT_NEIGHBOURS),
        outside=_FEW_OUTSIDE,
        near=None,
    ),
    "RocketLanding-v0": ProblemSets(
        training=_training(16_000, _FEW),
        development=_development(_SEVERAL),
        validation=_validation(1_000, _SEVERAL),
        # Further outside, some instances cannot stay above the glide slope.
        outside=replace(_FEW_OUTSIDE, beyond=(0.02, 0.1)),
        near=None,  # at the height of the pad there is nothing to land from
    ),
    "TwoLinkArm-v0": ProblemSets(
        training=_training(12_000, _FEW),
        development=_development(_SEVERAL),
        validation=_validation(1_000, _SEVERAL),
        outside=_FEW_OUTSIDE,
        near=None,
    ),
    "PlanarQuadcopterDiscs-v0": ProblemSets(
        training=_training(4_000, _EVERY_SIDE),
        development=_development(_EVERY_SIDE_OFTEN),
        validation=_validation(1_000, _EVERY_SIDE_OFTEN),
        outside=replace(_FEW_OUTSIDE, settings=replace(WITHOUT_NEIGHBOURS, starts=30)),
        near=None,
    ),
    "QuadcopterRecovery-v0": ProblemSets(
        training=_training(12_000, _ONE_OPTIMUM),
        development=_development(_CHECKED),
        validation=_validation(1_000, _CHECKED),
        outside=replace(_OUTSIDE_ONE_OPTIMUM, beyond=(0.0, 0.25)),
        near=None,
    ),
}


def sets_of(problem: OptimalControlProblem) -> ProblemSets:
    """The sets of ``problem``: those of the benchmark, or the defaults for a problem of the user."""
    if problem.id in _BENCHMARK:
        return _BENCHMARK[problem.id]
    near = _NEAR if initial_values(problem) else None
    match discontinuity_of(problem):
        case SphereCentre():
            return ProblemSets(boundary=NearCentre(_SEEDS["boundary"]), near=near)
        case EqualCosts():
            return ProblemSets(boundary=NearEqualCosts(_SEEDS["boundary"], 20_000), near=near)
        case _:
            return ProblemSets(near=near)
