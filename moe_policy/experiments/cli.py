"""The command line of the scripts: options that mean the same in all of them, and where results are written.

A run writes into ``runs/``, which git ignores. With ``--ship`` it writes into ``results/``, the committed records (and,
where a script makes models or tables, into the package). ``--results`` names any other folder and takes precedence.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import NoReturn

import torch

import ocp_envs
from moe_policy.experiments.records import Record, write
from moe_policy.store import SHIPPED
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import UnknownProblemError

ROOT = Path(__file__).resolve().parents[2]
#: Folders of the databases, of a user's results, and of the committed records.
DATA, RUNS, RECORDS = ROOT / "data", ROOT / "runs", ROOT / "results"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line and exit with status 2."""

    def error(self, message: str) -> NoReturn:
        """Print ``message`` without the usage, and exit with status 2."""
        self.exit(2, f"{self.prog}: error: {message}\n")

    def parse(self) -> argparse.Namespace:
        """The arguments of the command line.

        Those of `parser` are ``problem`` (of ``--env``), ``data``, ``results``, ``ship``, ``models``, ``workers``,
        ``seed`` and ``cases``, each where the script has the option; folders are resolved.
        """
        arguments = self.parse_args()
        for folder, record, run in (("results", RECORDS, RUNS), ("models", SHIPPED, RUNS / "models")):
            if getattr(arguments, folder, self) is None:
                setattr(arguments, folder, record if arguments.ship else run)
        return arguments


def parser(
    doc: str | None,
    *,
    env: str | None = "PendulumSwingup-v0",
    data: bool = False,
    results: bool = True,
    models: bool = False,
    ship: str = "write into results/, the committed records, instead of runs/",
    workers: bool = False,
    seed: int | None = None,
    cases: str | None = None,
    default_cases: int | None = None,
) -> Parser:
    """A parser with the common options of the scripts; ``doc``, the docstring of the script, is shown by ``--help``.

    ``env`` and ``seed`` are the defaults of ``--env`` and ``--seed``, ``None`` for scripts without these options;
    ``cases`` says what ``--cases`` counts, ``None`` for scripts without it, and ``default_cases`` its default, ``None``
    for all. The others say whether there are ``--data`` (folder of the databases), ``--results`` and ``--ship`` (which
    does what ``ship`` says), ``--models`` (folder of models; needs ``results``) and ``--workers``.
    """
    made = Parser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if env is not None:
        known = ", ".join(ocp_envs.names())
        made.add_argument(
            "--env", dest="problem", metavar="ID", type=problem_of, default=env, help=f"{known}; default {env}"
        )
    if data:
        made.add_argument("--data", metavar="FOLDER", type=Path, default=DATA, help="databases; data/ by default")
    if results:
        made.add_argument("--results", metavar="FOLDER", type=Path, help="where results go; runs/ by default")
        made.add_argument("--ship", action="store_true", help=ship)
    if models:
        made.add_argument("--models", metavar="FOLDER", type=Path, help="where models go; runs/models by default")
    if workers:
        made.add_argument("--workers", metavar="N", type=positive, help="processes; one per core by default")
    if seed is not None:
        made.add_argument("--seed", metavar="N", type=int, default=seed, help=f"random seed; default {seed}")
    if cases is not None:
        shown = f"number of {cases}; {default_cases or 'all'} by default"
        made.add_argument("--cases", metavar="N", type=positive, default=default_cases, help=shown)
    return made


def problem_of(name: str) -> OptimalControlProblem:
    """The problem called ``name``; the parser turns an unknown name into an error that suggests the nearest one."""
    try:
        return ocp_envs.load(name)
    except UnknownProblemError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def positive(text: str) -> int:
    """A whole number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number of 1 or more")
    return int(text)


def threads() -> None:
    """Keep PyTorch to one thread: the networks are too small to gain from more."""
    torch.set_num_threads(1)


def one_core() -> None:
    """Keep this process and those that it starts, such as the solver's, to one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def publish(arguments: argparse.Namespace, name: str, record: Record) -> Path:
    """Write ``record`` to ``<name>.json`` in the folder of the results, say so, and return the path."""
    path: Path = arguments.results / f"{name}.json"
    write(path, record)
    say(f"wrote {path}")
    return path


def say(text: str = "") -> None:
    """Print ``text`` at once, also into a pipe."""
    print(text, flush=True)
