"""Models on disk: tensors in ``<path>.safetensors`` and everything else in ``<path>.json``. Nothing is ever unpickled.

The description names the problem by id and fingerprint, so that a model cannot be used for another problem, and carries
the SHA-256 of the tensor file, so that a damaged file or a pair of files from two different saves is refused.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from ocp_envs import problems
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.files import replacing
from ocp_envs.support.provenance import provenance, write_json
from ocp_envs.support.suggestions import did_you_mean

FORMAT = "ocp-moe model"
VERSION = 1
SHIPPED = Path(__file__).parent / "models"
#: Which function makes an object out of a file of each kind: (ModelFile, problem) → planner or policy.
READERS = {
    "network": ("moe_policy.planners.network", "read_network"),
    "nearest": ("moe_policy.planners.nearest", "read_nearest"),
    "rl": ("moe_policy.rl.actor", "read_policy"),
}
#: What needs no file: problem → planner or policy.
ALWAYS = {
    "optimal": ("moe_policy.planners.solver", "with_shipped_samples"),
    "stabiliser": ("moe_policy.control.stabiliser", "Stabiliser"),
}


class ModelFileError(ValueError):
    """A model's files are missing, damaged, of another format or for another problem."""


class UnknownModelError(KeyError):
    """No model of that name is shipped."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, eq=False)
class ModelFile:
    """What was read: ``tensors`` by name, and the ``description`` of the JSON file."""

    path: Path
    tensors: Mapping[str, NDArray[Any]]
    description: Mapping[str, Any]


def _pair(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    base = Path(path)
    if base.suffix in (".safetensors", ".json"):
        base = base.with_suffix("")
    # Not with_suffix: names such as "moe-retrained-softmax-0.1" contain a dot.
    return base.with_name(base.name + ".safetensors"), base.with_name(base.name + ".json")


def write_model(
    path: str | os.PathLike[str],
    kind: str,
    problem: OptimalControlProblem,
    tensors: Mapping[str, NDArray[Any]],
    description: Mapping[str, Any],
) -> None:
    """Write ``<path>.safetensors`` and ``<path>.json``, each atomically, making folders as needed.

    Args:
        path: with or without one of the two suffixes.
        kind: which reader of :data:`READERS` makes the object again.
        problem: what the model is for.
        tensors: arrays by name.
        description: whatever else the reader needs, as JSON; finite numbers only.
    """
    if kind not in READERS:
        raise ValueError(f"unknown kind of model {kind!r}; known are {sorted(READERS)}")
    tensor_path, json_path = _pair(path)
    content = save_tensors({name: np.ascontiguousarray(array) for name, array in tensors.items()})
    record = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "problem": problem.id,
        "fingerprint": problem.fingerprint,
        "sha256": hashlib.sha256(content).hexdigest(),
        **description,
        "provenance": provenance(),
    }
    with replacing(tensor_path) as file:
        file.write(content)
    write_json(json_path, record)


def read_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read a pair of files and check that they are whole and belong together.

    Raises:
        ModelFileError: a file is missing, truncated, damaged or foreign.
    """
    tensor_path, json_path = _pair(path)
    for part in (json_path, tensor_path):
        if not part.is_file():
            raise ModelFileError(f"{part} is missing; a model is a pair of files, .safetensors and .json")
    try:
        description = json.loads(json_path.read_bytes())
    except ValueError as error:
        raise ModelFileError(f"{json_path} is not valid JSON ({error}); it is damaged or no model") from error
    if not isinstance(description, dict) or description.get("format") != FORMAT:
        raise ModelFileError(f"{json_path} does not describe a model: expected 'format': {FORMAT!r}")
    if description.get("version") != VERSION:
        raise ModelFileError(
            f"{json_path} has format version {description.get('version')!r}, this program reads {VERSION}; "
            "use the version of the program that wrote it, or train again"
        )
    content = tensor_path.read_bytes()
    if hashlib.sha256(content).hexdigest() != description.get("sha256"):
        raise ModelFileError(f"{tensor_path} is truncated, damaged, or from another save than {json_path.name}")
    try:
        tensors = load_tensors(content)
    except (SafetensorError, KeyError, ValueError) as error:
        raise ModelFileError(f"{tensor_path} is not a safetensors file ({error})") from error
    return ModelFile(tensor_path.with_suffix(""), tensors, description)


def _resolve(target: tuple[str, str]) -> Any:
    module, name = target
    return getattr(importlib.import_module(module), name)


def load_file(path: str | os.PathLike[str], problem: OptimalControlProblem | None = None) -> Any:
    """The planner or policy saved at ``path``.

    Args:
        path: with or without one of the suffixes ``.safetensors`` and ``.json``.
        problem: what it is to be used for; by default the registered problem of the id in the file.

    Raises:
        ModelFileError: the files are unusable, or made for another problem.
        UnknownProblemError: the problem in the file is not registered.
    """
    file = read_model(path)
    if file.description.get("kind") not in READERS:
        raise ModelFileError(f"{file.path}: unknown kind {file.description.get('kind')!r}; known are {sorted(READERS)}")
    problem = problems.load(str(file.description.get("problem"))) if problem is None else problem
    found = (file.description.get("problem"), file.description.get("fingerprint"))
    if found != (problem.id, problem.fingerprint):
        raise ModelFileError(
            f"{file.path} was made for {found[0]} with fingerprint {found[1]}, not for {problem.id} with "
            f"{problem.fingerprint}: the problem is another one or has changed since; train again"
        )
    try:
        return _resolve(READERS[file.description["kind"]])(file, problem)
    except (KeyError, TypeError, RuntimeError, ValueError) as error:
        raise ModelFileError(f"{file.path}: tensors and description do not fit together ({error})") from error


def available(env_id: str) -> list[str]:
    """Names that :func:`load` knows for the problem ``env_id``.

    Raises:
        UnknownProblemError: no such problem.
    """
    problem = problems.load(env_id)
    shipped = {path.name.removesuffix(".json") for path in (SHIPPED / problem.id).glob("*.json")}
    # Where the goal cannot be held there is no controller that stabilises it.
    return sorted(shipped | (set(ALWAYS) if problem.hold else set(ALWAYS) - {"stabiliser"}))


def load(env_id: str, name: str) -> Any:
    """The shipped planner or policy ``name`` of the problem ``env_id``.

    Raises:
        UnknownProblemError: no such problem.
        UnknownModelError: no such model; the message names the nearest one.
        ModelFileError: its files are unusable.
    """
    names = available(env_id)
    if name not in names:
        raise UnknownModelError(f"{env_id} has no model {name!r}; {did_you_mean(name, names)}there are {names}")
    problem = problems.load(env_id)
    if name in ALWAYS:
        return _resolve(ALWAYS[name])(problem)
    return load_file(SHIPPED / problem.id / name, problem)
