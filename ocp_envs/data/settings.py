"""Settings of the generation of a database."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

from ocp_envs.solvers.guesses import GuessKind
from ocp_envs.solvers.nlp import SolverSettings
from ocp_envs.support.doors import checked

_MINIMUM = {"first": 1, "starts": 1, "neighbours": 1, "lookaround": 1, "cold": 0, "chunk": 1, "fit": 0}
#: Fields added after the first databases were made: left out of a record at these values, so that the records and keys
#: of older databases stay equal.
_ADDED = {"guess": "drift", "fit": 0}


@checked
@dataclass(frozen=True)
class GenerationSettings:
    """How a database is made.

    Args:
        first: n₀, the number of instances in the first round; rounded up to whole chunks.
        starts: guesses for each winding in the first round.
        neighbours: warm starts for each solution family that is tried: the solutions of that many nearest neighbours.
        lookaround: number of nearest neighbours whose solution families are considered.
        margin: a neighbour's family is tried if its cost exceeds the neighbour's lowest by at most this fraction.
        cold: guesses for each winding in later rounds, in addition to the warm starts.
        chunk: instances solved in one task and written in one step.
        solver: settings of the solves.
        guess: kind of the guesses for a winding after the first one, which is always a line.
        fit: if positive, each family that is tried gets one warm start instead, a local linear fit through its ``fit``
            nearest solutions, evaluated at the instance's parameters. ``neighbours`` applies only where there are too
            few solutions for a fit, np or fewer.

    Raises:
        ValueError: a number below its minimum, or an unknown kind of guess.
    """

    first: int = 200
    starts: int = 8
    neighbours: int = 2
    lookaround: int = 8
    margin: float = 0.3
    cold: int = 0
    chunk: int = 100
    solver: SolverSettings = field(default_factory=SolverSettings)
    guess: GuessKind = "drift"
    fit: int = 0

    def __post_init__(self) -> None:
        for name, minimum in _MINIMUM.items():
            if getattr(self, name) < minimum:
                raise ValueError(f"{name} must be at least {minimum}, got {getattr(self, name)}")
        if not self.margin >= 0:
            raise ValueError(f"margin must be at least 0, got {self.margin}")

    @classmethod
    def thorough(cls) -> GenerationSettings:
        """Settings for evaluation sets, whose costs are references: more guesses, also next to the warm starts."""
        return cls(starts=12, cold=1)

    def record(self) -> dict[str, object]:
        """The settings as JSON, the way databases store them."""
        values = dataclasses.asdict(self)
        return {name: value for name, value in values.items() if name not in _ADDED or value != _ADDED[name]}


DEFAULT_GENERATION = GenerationSettings()
