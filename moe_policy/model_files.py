"""Files of models: tensors in ``<path>.safetensors`` and everything else in ``<path>.json``; nothing is unpickled.

The description names the problem by id and fingerprint, so that a model cannot be used for another problem, and carries
the SHA-256 of the tensor file, so that a damaged file, or a pair of files from two different saves, is refused. It also
carries a checksum of its own content, so that any edit is refused. Files of format version 1 were saved before this
checksum was introduced and are read without it.

Tensors of floating-point numbers are written in half or single precision where it represents every one of them exactly,
as after ``rounded`` of a planner; otherwise in the precision that they have.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.checksums import KEY as CHECKSUM
from ocp_envs.support.checksums import intact, with_checksum
from ocp_envs.support.files import replacing
from ocp_envs.support.provenance import plain, provenance, write_json

FORMAT = "ocp-moe model"
VERSION = 2
#: Which reader makes the planner or the policy again.
Kind = Literal["network", "nearest", "rl"]
#: What the description of each kind holds besides what is common to all.
CONTENT: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "network": frozenset({"name", "sizes", "mixing", "details"}),
        "nearest": frozenset({"name"}),
        "rl": frozenset({"algorithm", "sizes", "activation", "squash", "period", "details"}),
    }
)
_COMMON = frozenset({"format", "version", "kind", "problem", "fingerprint", "sha256", "provenance"})
Tensors = Mapping[str, NDArray[Any]]
#: An object of JSON.
Json = Mapping[str, Any]


class ModelFileError(ValueError):
    """A model's files are missing, damaged, of another format or for another problem."""


@dataclass(frozen=True, eq=False)
class ModelFile:
    """What was read at ``path`` (without a suffix): the ``tensors`` by name and the JSON ``description``."""

    path: Path
    tensors: Tensors
    description: Json

    def check_problem(self, problem: OptimalControlProblem) -> None:
        """Check that the model was made for ``problem`` as it is now, else raise a ModelFileError."""
        found = self.description.get("problem"), self.description.get("fingerprint")
        if found != (problem.id, problem.fingerprint):
            raise ModelFileError(
                f"{self.path} was made for {found[0]} with fingerprint {found[1]}, not for {problem.id} with "
                f"{problem.fingerprint}: it is another problem, or it has changed since; train again"
            )


def _pair(path: str | os.PathLike[str]) -> tuple[Path, Path]:
    base = Path(path)
    if not base.name:
        raise ValueError(f"path: expected a folder and a name, got {os.fspath(path)!r}")
    if base.suffix in (".safetensors", ".json"):
        base = base.with_suffix("")
    # Not with_suffix: names such as "moe-retrained-softmax-0.1" contain a dot.
    return base.with_name(base.name + ".safetensors"), base.with_name(base.name + ".json")


def in_half_precision(array: NDArray[Any]) -> NDArray[Any]:
    """``array`` with its numbers rounded to half precision (by at most 1 part in 2048), in the type that it has.

    Numbers beyond ±65504, the range of half precision, become infinite.
    """
    with np.errstate(over="ignore"):
        return array.astype(np.float16).astype(array.dtype)


def write_model(
    path: str | os.PathLike[str], kind: Kind, problem: OptimalControlProblem, tensors: Tensors, description: Json
) -> None:
    """Write ``tensors`` to ``<path>.safetensors`` and everything else to ``<path>.json``, each atomically; folders are
    made as needed. The file names the ``kind`` of reader and the ``problem``, and holds the ``description`` for the
    reader: JSON with finite numbers only.
    """
    if kind not in CONTENT:
        raise ValueError(f"unknown kind of model {kind!r}; known are {sorted(CONTENT)}")
    if description.keys() != CONTENT[kind]:
        raise ValueError(f"expected a description with {sorted(CONTENT[kind])}, got {sorted(description)}")
    tensor_path, json_path = _pair(path)
    content = save_tensors({name: np.ascontiguousarray(_smallest(array)) for name, array in tensors.items()})
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
    write_json(json_path, with_checksum(plain(record)))


def _smallest(array: NDArray[Any]) -> NDArray[Any]:
    """``array`` in half or single precision where no floating-point number in it changes."""
    if array.dtype.kind != "f":
        return array
    for kind in (np.float16, np.float32):
        with np.errstate(over="ignore"):
            shorter = array.astype(kind)
        if np.array_equal(shorter, array, equal_nan=True):
            return shorter
    return array


def read_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read the pair of files at ``path``, with or without a suffix, and check that they belong together.

    Raises:
        ModelFileError: a file is missing, truncated, damaged or foreign.
    """
    tensor_path, json_path = _pair(path)
    for part in (json_path, tensor_path):
        if not part.is_file():
            raise ModelFileError(f"{part} is missing; a model is a pair of files, .safetensors and .json")
    description = _read_description(json_path)
    content = tensor_path.read_bytes()
    if hashlib.sha256(content).hexdigest() != description["sha256"]:
        raise ModelFileError(f"{tensor_path} is truncated, damaged, or from another save than {json_path.name}")
    try:
        tensors = load_tensors(content)
    except (SafetensorError, KeyError, ValueError) as error:
        raise ModelFileError(f"{tensor_path} is not a safetensors file ({error})") from error
    return ModelFile(tensor_path.with_suffix(""), tensors, description)


def _read_description(path: Path) -> Json:
    """The JSON of a model in the file ``path``, as it was written, with the keys of its kind."""
    try:
        description = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path} is not valid JSON ({error}); it is damaged, or not a model") from error
    if not isinstance(description, dict) or description.get("format") != FORMAT:
        raise ModelFileError(f"{path} does not describe a model: expected 'format': {FORMAT!r}")
    version, kind = description.get("version"), description.get("kind")
    if version not in (1, VERSION):
        raise ModelFileError(f"{path} has format version {version!r:.99}, expected 1 or {VERSION}; train again")
    if version == VERSION and not intact(description):
        raise ModelFileError(
            f"{path} was edited or is damaged: the checksum of its content differs; restore it from a copy, or change "
            "the model in Python and save it again"
        )
    if not isinstance(kind, str) or kind not in CONTENT:
        raise ModelFileError(f"{path}: unknown kind {kind!r:.99}; known are {sorted(CONTENT)}")
    expected = _COMMON | CONTENT[kind] | ({CHECKSUM} if version == VERSION else set())
    if description.keys() != expected:
        unknown, missing = sorted(description.keys() - expected), sorted(expected - description.keys())
        raise ModelFileError(f"{path} is damaged: got unknown keys {unknown}, and {missing} are missing")
    return description
