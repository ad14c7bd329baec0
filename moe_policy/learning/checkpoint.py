"""Unfinished trainings on disk: a training that is interrupted goes on and ends with the same weights."""

from __future__ import annotations

import hashlib
import os
import pickle
import time
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ocp_envs.support.files import replacing


class CheckpointError(ValueError):
    """A file that is no checkpoint, or one of another training."""


def identify(*facts: object, tensors: Sequence[Tensor] = ()) -> str:
    """A hash of what a training depends on."""
    sha = hashlib.sha256(repr(facts).encode())
    for tensor in tensors:
        sha.update(tensor.contiguous().numpy().tobytes())
    return sha.hexdigest()


class Checkpoint:
    """The file with the state of one training.

    Args:
        path: where it is.
        identity: what the training depends on, from :func:`identify`.
        every: seconds between two states that are written.
    """

    def __init__(self, path: str | os.PathLike[str], identity: str, every: float = 60.0) -> None:
        self.path, self.identity, self.every = Path(path), identity, every
        self._written = time.monotonic()

    def read(self) -> dict[str, Any] | None:
        """The state that was written last; ``None`` where there is none.

        Raises:
            CheckpointError: a damaged file, or one of a training with other data, settings or seed.
        """
        if not self.path.exists():
            return None
        try:
            record = torch.load(self.path, weights_only=True)
            identity, state = record["identity"], record["state"]
        except (OSError, RuntimeError, EOFError, KeyError, TypeError, pickle.UnpicklingError, zipfile.BadZipFile) as e:
            raise CheckpointError(f"{self.path} is damaged, or not a checkpoint; delete it to start anew") from e
        if identity != self.identity:
            raise CheckpointError(
                f"{self.path} belongs to a training with other data, settings or seed; delete it, or keep the "
                "checkpoints of every training in a folder of their own"
            )
        return dict(state)

    def write(self, state: dict[str, Any]) -> None:
        """Keep ``state`` in place of what was written before."""
        with replacing(self.path) as file:
            torch.save({"identity": self.identity, "state": state}, file)
        self._written = time.monotonic()

    @property
    def due(self) -> bool:
        """Whether it is time to write."""
        return time.monotonic() - self._written >= self.every
