"""What the generation of a database took, as its records keep it."""

from __future__ import annotations

from dataclasses import dataclass

from moe_policy.experiments.records import Record
from ocp_envs.data.database import Database


@dataclass(frozen=True, kw_only=True)
class Totals(Record):
    """Sums over the instances in a database."""

    problems: int  # instances whose chunk is complete
    solved: int  # those with a solution
    solves: int  # attempts to solve them
    failures: int  # attempts without a verified solution
    fallbacks: int  # attempts that went to the second solver
    iterations: int  # of all attempts

    @classmethod
    def of(cls, database: Database) -> Totals:
        """The totals of ``database``."""
        return cls(**database.totals())
