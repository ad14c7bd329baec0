"""The command line of the scripts: options that mean the same in all of them, and where results are written.

A run writes into ``runs/``, which git ignores. With ``--ship`` it writes into ``results/``, the committed records (and,
where a script makes models or tables, into the package). ``--results`` names any other folder and takes precedence.
Default folders are those of the repository, wherever a script is called.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import torch
from tqdm import tqdm

import ocp_envs
from moe_policy.experiments import install
from moe_policy.experiments.running import UsageError as UsageError
from moe_policy.experiments.running import option as option
from moe_policy.experiments.running import run as run
from moe_policy.reports.records import Record, write
from moe_policy.store import SHIPPED
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.problems import BENCHMARK, UnknownProblemError
from ocp_envs.support.pool import import_in_workers
from ocp_envs.support.suggestions import did_you_mean

ROOT = Path(__file__).resolve().parents[2]
#: Folders of the databases, of a user's results, and of the committed records.
DATA, RUNS, RECORDS = ROOT / "data", ROOT / "runs", ROOT / "results"
_FOLDERS = "Folders that you name are relative to the working directory; default folders are in the repository."


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line and exit with status 2."""

    #: Options that name folders which the script writes to.
    outputs: tuple[str, ...] = ()

    def error(self, message: str) -> NoReturn:
        """Print ``message`` without the usage, and exit with status 2."""
        self.exit(2, f"{self.prog}: error: {message}\n")

    def parse(self) -> argparse.Namespace:
        """The arguments of the command line.

        Those of `parser` are ``problem`` (of ``--env``), ``data``, ``results``, ``ship``, ``models``, ``workers``,
        ``seed`` and ``cases``, each where the script has the option; folders are resolved.
        """
        arguments = self.parse_args()
        for folder, shipped, usual in (("results", RECORDS, RUNS), ("models", SHIPPED, RUNS / "models")):
            if getattr(arguments, folder, self) is None:
                setattr(arguments, folder, shipped if arguments.ship else usual)
        for name in self.outputs:
            if fault := fault_of(getattr(arguments, name)):
                self.error(f"argument --{name}: {fault}")
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
    folders = _FOLDERS if data or results or models else None
    made = Parser(description=doc, epilog=folders, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.outputs = tuple(name for name, there in (("results", results), ("models", models)) if there)
    if env is not None:
        known = f"{', '.join(ocp_envs.names())}, or MODULE:PROBLEM, a variable or the id of yours; default {env}"
        made.add_argument("--env", dest="problem", metavar="ID", type=problem_of, default=env, help=known)
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
        made.add_argument("--seed", metavar="N", type=whole, default=seed, help=f"random seed; default {seed}")
    if cases is not None:
        shown = f"number of {cases}; {default_cases or 'all'} by default"
        made.add_argument("--cases", metavar="N", type=positive, default=default_cases, help=shown)
    return made


def problem_of(name: str) -> OptimalControlProblem:
    """The problem called ``name``, or ``"module:PROBLEM"``, a variable of a module or the id of what it registers.

    A module in the working directory is found; worker processes import it, too. A problem that is not registered yet is
    registered. The parser turns an error into one that suggests the nearest name.
    """
    module, _, own = name.rpartition(":")
    try:
        found = _of_module(module, own) if module else ocp_envs.load(own)
    except (UnknownProblemError, ImportError, ValueError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    _GIVEN[found.id] = name
    return found


#: How problems were named on the command line, by their ids.
_GIVEN: dict[str, str] = {}


def _of_module(module: str, own: str) -> OptimalControlProblem:
    """The problem ``own`` of ``module``, registered."""
    sys.path.append(os.getcwd())
    variables = vars(importlib.import_module(module))
    import_in_workers(module)
    problem = variables.get(own)
    if isinstance(problem, OptimalControlProblem):
        ocp_envs.register(problem)
        return problem
    if own in ocp_envs.names():
        return ocp_envs.load(own)
    there = sorted(name for name, value in variables.items() if isinstance(value, OptimalControlProblem))
    ids = [each for each in ocp_envs.names() if each not in {problem.id for problem in BENCHMARK}]
    raise UnknownProblemError(
        f"{module} has no problem {own!r}; {did_you_mean(own, [*there, *ids])}it has the variables {there}, and "
        f"registered are {ids}"
    )


def positive(text: str) -> int:
    """A whole number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number of 1 or more")
    return int(text)


def whole(text: str) -> int:
    """A whole number of 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number of 0 or more")
    return int(text)


def amount(text: str) -> float:
    """A finite number of 0 or more."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number of 0 or more")
    return value


def fault_of(folder: Path) -> str | None:
    """Why files cannot be written into ``folder``, which need not exist; ``None`` if they can."""
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        return f"{there} is not a folder"
    return None if os.access(there, os.W_OK | os.X_OK) else f"{there} is not writable"


def at_most(count: int | None, there: int, what: str, name: str = "--cases") -> None:
    """Refuse a ``count`` of the option ``name`` that exceeds the number ``there`` is of ``what``.

    Raises:
        UsageError: it does.
    """
    if count is not None and count > there:
        raise UsageError(f"{name}: got {count:,}, there are {there:,} {what}")


def need(module: str) -> None:
    """Exit, before work begins, where the optional package ``module`` is missing; the message says what to install."""
    if find_spec(module) is None:
        raise SystemExit(install(module))


def database(arguments: argparse.Namespace, name: str) -> ocp_envs.Database:
    """The database ``name`` of ``arguments.problem`` in the folder ``arguments.data``.

    Raises:
        DatabaseError: it is damaged, or made for another problem.
        SystemExit: there is none; the message is the command that makes it.
    """
    path = arguments.data / arguments.problem.id / f"{name}.zarr"
    if not path.exists():
        given = _GIVEN.get(arguments.problem.id, arguments.problem.id)
        folder = "" if arguments.data == DATA else f" --data {arguments.data}"
        command = f"python scripts/generate_data.py --env {given} --splits {name}{folder}"
        raise SystemExit(f"there is no database {path}; make it with: {command}")
    return ocp_envs.Database.open(path, arguments.problem)


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
    """Print ``text`` at once, also into a pipe, and above a bar that shows progress."""
    tqdm.write(text)
    sys.stdout.flush()
