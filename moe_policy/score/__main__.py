"""Measure a planner or a policy on the fixed instances of a problem, and make a table of such scores.

    python -m moe_policy.score module:factory --env PendulumSwingup-v0
    python -m moe_policy.score moe-custom --env PendulumSwingup-v0
    python -m moe_policy.score --table score_*.json

A factory takes a problem, and if it likes an argument seed, and returns a planner (called with parameters (B, np), it
returns trajectories) or a policy (with predict, as in Stable-Baselines3). A name without a colon is that of a shipped
model. Modules in the working directory are found. The score is written to score_<method>_<env>.json.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from moe_policy import store
from moe_policy.protocols import Planner, Policy
from moe_policy.reports.records import RecordError, read, write
from moe_policy.score.scoring import Factory, Score, score_method, table
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import UnknownProblemError
from ocp_envs.support import progress
from ocp_envs.tables import TableError


def factory_of(text: str) -> Factory:
    """The factory ``module:factory``, or that of a shipped model, ``text`` being its name.

    Raises:
        ValueError: no such module, or nothing of that name in it that can be called.
    """
    module, colon, name = text.partition(":")
    if not colon:
        return _shipped(text)
    sys.path.insert(0, os.getcwd())
    try:
        factory = getattr(importlib.import_module(module), name, None)
    except ImportError as error:
        raise ValueError(f"{text}: {error}") from error
    if not callable(factory):
        raise ValueError(f"{text}: {module} has nothing called {name!r} that can be called")
    found: Factory = factory
    return found


def _shipped(name: str) -> Factory:
    def shipped(problem: OptimalControlProblem) -> Planner | Policy:
        return store.load(problem, name)

    shipped.__module__, shipped.__qualname__ = "shipped", name
    return shipped


def _parser() -> argparse.ArgumentParser:
    doc, form = __doc__, argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m moe_policy.score", description=doc, formatter_class=form)
    parser.add_argument("method", nargs="?", help="module:factory, or the name of a shipped model")
    parser.add_argument("--env", metavar="ID", default="PendulumSwingup-v0", help="problem; default %(default)s")
    parser.add_argument("--split", nargs="+", metavar="NAME", help="uniform, boundary, outside, near; the first three")
    parser.add_argument("--cases", metavar="N", type=int, help="the first N instances of each split; all by default")
    parser.add_argument("--seeds", metavar="S", type=int, nargs="+", help="seeds that the factory gets, in turn")
    parser.add_argument("--name", help="of the method in tables; by default that of the factory")
    parser.add_argument("--workers", metavar="N", type=int, help="processes that solve optima; one per core by default")
    parser.add_argument("--out", metavar="FOLDER", type=Path, default=Path(), help="where the score goes; here")
    parser.add_argument("--table", metavar="FILE", type=Path, nargs="+", help="print the table of these scores instead")
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Run with the command line ``arguments``, by default those of the process; errors are one line and status 2."""
    parser = _parser()
    given = parser.parse_args(arguments)
    progress.show(True)
    try:
        if given.table:
            print(table([read(path, Score) for path in given.table]), end="")
            return
        if given.method is None:
            parser.error("expected module:factory, the name of a shipped model, or --table")
        found = _measure(given)
    except (ValueError, OSError, UnknownProblemError, store.UnknownModelError, TableError, RecordError) as error:
        parser.error(str(error))
    path = given.out / f"score_{found.method}_{found.env_id}.json"
    write(path, found)
    print(f"{found.table}\nwrote {path}")


def _measure(given: argparse.Namespace) -> Score:
    factory = factory_of(given.method)
    name = given.name or given.method.rpartition(":")[2]
    return score_method(
        given.env,
        factory,
        name=name,
        splits=given.split,
        cases=given.cases,
        seeds=given.seeds,
        workers=given.workers,
    )


if __name__ == "__main__":
    main()
