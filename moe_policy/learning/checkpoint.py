"""Checkpoints of unfinished trainings: a training that was interrupted continues and ends with the same weights."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ocp_envs.support.archives import check_archive
from ocp_envs.support.files import replacing

#: Numbers, lists, dictionaries and tensors by name, which PyTorch writes and reads without unpickling objects.
State = dict[str, Any]


class CheckpointError(ValueError):
    """A file that is no checkpoint, or one of another training."""


def identify(*facts: object, tensors: Sequence[Tensor] = ()) -> str:
    """A hash of what a training depends on: the ``repr`` of ``facts``, and every byte of ``tensors``."""
    sha = hashlib.sha256(repr(facts).encode())
    for tensor in tensors:
        sha.update(tensor.contiguous().numpy().tobytes())
    return sha.hexdigest()


class Checkpoint:
    """The file at ``path`` with the state of the training of that ``identity``, a hash from :func:`identify`; it is due
    to be written ``every`` so many seconds.
    """

    def __init__(self, path: str | os.PathLike[str], identity: str, every: float = 60.0) -> None:
        self.path, self.identity, self.every = Path(path), identity, every
        self._written = time.monotonic()

    def read(self) -> State | None:
        """The last state that was written; ``None`` where there is none.

        Raises:
            CheckpointError: a damaged file, or one of a training with other data, settings or seed.
        """
        if not self.path.exists():
            return None
        try:
            check_archive(self.path)  # PyTorch writes checksums and does not compare them
            record = torch.load(self.path, map_location="cpu", weights_only=True)
            identity, state = record["identity"], record["state"]
        except Exception as error:  # what a foreign file makes PyTorch raise is its affair
            message = f"{self.path} is damaged, or not a checkpoint; delete it to begin again"
            raise CheckpointError(message) from error
        if identity != self.identity:
            message = "belongs to a training with other data, settings or seed; delete it, or choose another folder"
            raise CheckpointError(f"{self.path} {message}")
        return State(state)

    def write(self, state: State) -> None:
        """Write ``state`` in place of the last one."""
        with replacing(self.path) as file:
            torch.save({"identity": self.identity, "state": state}, file)
        self._written = time.monotonic()

    @property
    def due(self) -> bool:
        """Whether ``every`` seconds have passed since the last write."""
        return time.monotonic() - self._written >= self.every
