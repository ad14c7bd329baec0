"""Steps common to all training: samples are scaled and split before it; planner and record are built after."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from moe_policy.learning.architectures import Hidden, layer_sizes
from moe_policy.learning.examples import Examples, Split
from moe_policy.learning.parts import Part
from moe_policy.learning.settings import TrainingSettings
from moe_policy.planners.modules import Module, outputs_of
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import Mixing
from moe_policy.planners.record import PartReport, TrainingReport
from moe_policy.planners.scaling import Standardizer, blocks
from ocp_envs.data.beyond import Beyond
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support.arrays import Array, Ints, scratch
from ocp_envs.support.provenance import peak_memory_gb

#: Reads rows of an array that is too large to be held in double precision: rows → values (B, n).
_Read = Callable[[Ints | slice], Array]


def _fitted(read: _Read, rows: Ints) -> Standardizer:
    return Standardizer.fit_blocks(lambda: (read(rows[part]) for part in blocks(len(rows))))


def _scaled(scaler: Standardizer, read: _Read, count: int) -> NDArray[np.float32]:
    """All rows, standardised, in single precision."""
    scaled = scratch((count, len(scaler)), np.float32)
    for part in blocks(count):
        scaled[part] = scaler.scale(read(part))
    return scaled


@dataclass(frozen=True, eq=False)
class Prepared:
    """Samples of ``problem`` made ready for a training with ``settings`` and ``seed``.

    Args:
        inputs: scaler of p.
        outputs: scaler of flat trajectories.
        examples: standardised p (M, np) and flat trajectories (M, flat_size), and the split; in files where they are
            large (:func:`~ocp_envs.support.arrays.scratch`), so that a training reads its minibatches from disk.
        checkpoints: folder of this training's checkpoints, ``None`` to keep none.
    """

    problem: OptimalControlProblem
    settings: TrainingSettings
    seed: int
    inputs: Standardizer
    outputs: Standardizer
    examples: Examples
    checkpoints: Path | None = None

    @classmethod
    def of(
        cls,
        database: Samples | SampleSource,
        settings: TrainingSettings,
        seed: int,
        scalers: tuple[Standardizer, Standardizer] | None = None,
        checkpoints: Path | None = None,
    ) -> Prepared:
        """Split the samples of ``database`` as ``seed`` and ``settings`` say, and scale them by the ``scalers`` of
        inputs and outputs, by default those of the training split. The folder ``checkpoints`` is kept for the training.
        """
        checkpoints = None if checkpoints is None else Path(checkpoints)
        samples = samples_of(database)
        count = len(samples.parameters)
        split = Split.draw(count, settings.test_share, seed)

        def parameters(rows: Ints | slice) -> Array:
            return samples.parameters[rows]

        def flat(rows: Ints | slice) -> Array:
            return samples.trajectory[rows].flat()

        inputs, outputs = scalers or (_fitted(parameters, split.training), _fitted(flat, split.training))
        examples = Examples(_scaled(inputs, parameters, count), _scaled(outputs, flat, count), split)
        return cls(samples.problem, settings, seed, inputs, outputs, examples, checkpoints)

    def with_beyond(self, families: Ints, k: int, beyond: Beyond | None) -> tuple[Prepared, Ints]:
        """These examples and the trajectories ``beyond`` the borders of the ``k`` ``families`` (M,), and the family of
        each; −1 for none.

        Raises:
            ValueError: trajectories of other samples or families.
        """
        if beyond is None:
            return self, families
        if beyond.cost.shape != (len(families), k):
            raise ValueError(
                f"beyond: expected trajectories of {k} families of {len(families)} samples, got costs of shape "
                f"{beyond.cost.shape}; make it from these samples and labels"
            )
        y = self.outputs.scale(beyond.trajectory.flat()).astype(np.float32)
        examples = self.examples.with_further(beyond.rows, y)
        return dataclasses.replace(self, examples=examples), np.concatenate([families, beyond.family])

    def checkpoint(self, name: str) -> Path | None:
        """The checkpoint of the part called ``name``."""
        return None if self.checkpoints is None else self.checkpoints / f"{name.replace(' ', '-')}.pt"

    def _part(self, name: str, sizes: tuple[int, ...], stream: int, examples: Examples) -> Part:
        return Part(name, sizes, stream, examples.compact(), self.settings, self.seed, self.checkpoint(name))

    def regressor(self, name: str, hidden: Hidden, stream: int, split: Split | None = None) -> Part:
        """The training of the network ``name`` with ``hidden`` layers and the random stream ``stream``, which predicts
        the trajectories of ``split``, by default of all samples.
        """
        examples = self.examples if split is None else dataclasses.replace(self.examples, split=split)
        return self._part(name, layer_sizes(self.problem, hidden), stream, examples)

    def classifier(self, name: str, hidden: Hidden, stream: int, classes: Ints, count: int) -> Part:
        """The training of the network ``name`` with ``hidden`` layers and the random stream ``stream``, which predicts
        the class of every sample, ``classes`` (M,) in 0 … ``count`` − 1.
        """
        examples = dataclasses.replace(self.examples, y=np.array(classes))
        return self._part(name, layer_sizes(self.problem, hidden, count), stream, examples)

    def planner(
        self, name: str, module: Module, mixing: Mixing, parts: Sequence[PartReport], **details: object
    ) -> NetworkPlanner:
        """The planner called ``name``: a trained ``module``, its ``mixing``, and the record of its training with the
        reports of its ``parts`` and further ``details``, as JSON.
        """

        def loss(x: Tensor, y: Tensor, epoch: int) -> Tensor:
            return F.smooth_l1_loss(outputs_of(module, x, mixing), y)

        report = TrainingReport(tuple(parts), self.examples.test_loss(loss))
        record = {
            "seed": self.seed,
            "samples": len(self.examples.x),
            "settings": dataclasses.asdict(self.settings),
            **details,
            "training": report.summary() | {"peak_memory_gb": peak_memory_gb()},
        }
        return NetworkPlanner(self.problem, name, module.network(), self.inputs, self.outputs, mixing, record, report)
