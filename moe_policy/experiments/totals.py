"""What the generation of a database took, as its records keep it."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.records import Record
from ocp_envs.data.database import Database


@dataclass(frozen=True, kw_only=True)
class Totals(Record):
    """Sums over the instances in a database.

    Args:
        problems: instances whose chunk is complete.
        solved: those with a solution.
        solves: attempts to solve them.
        failures: attempts without a verified solution.
        fallbacks: attempts that went to the second solver.
        iterations: of all attempts.
    """

    problems: int
    solved: int
    solves: int
    failures: int
    fallbacks: int
    iterations: int

    @classmethod
    def of(cls, database: Database) -> Totals:
        """The totals of ``database``."""
        return cls(**database.totals())
