"""Describe a database or a problem, or write a database as one file of arrays.

    python -m ocp_envs.info data/PendulumSwingup-v0/training.zarr
    python -m ocp_envs.info data/PendulumSwingup-v0/training.zarr --npz training.npz
    python -m ocp_envs.info PendulumSwingup-v0

A database of a problem of your own is described once --module names the module that registers the problem.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ocp_envs.data.database import Database
from ocp_envs.data.layout import DatabaseError
from ocp_envs.data.summary import export_arrays, summary
from ocp_envs.envs.description import describe
from ocp_envs.problems import UnknownProblemError, names


def main(arguments: Sequence[str] | None = None) -> None:
    """Run with the command line ``arguments``, by default those of the process; errors are one line and status 2."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m ocp_envs.info", description=__doc__, formatter_class=form)
    parser.add_argument("what", help="folder of a database, or name of a problem")
    parser.add_argument("--npz", metavar="FILE", type=Path, help="write the best solutions of the database there")
    parser.add_argument("--module", help="module to import first, which registers a problem")
    given = parser.parse_args(arguments)
    try:
        if given.module:
            sys.path.insert(0, os.getcwd())
            importlib.import_module(given.module)
        _show(given.what, given.npz)
    except (ImportError, OSError, DatabaseError, UnknownProblemError) as error:
        parser.error(str(error))


def _show(what: str, npz: Path | None) -> None:
    if what in names() and not Path(what).exists():
        print(describe(what), end="")
        return
    database = Database.open(what)
    print(summary(database))
    if npz is not None:
        export_arrays(database, npz)
        print(f"wrote {npz}")


if __name__ == "__main__":
    main()
