"""What every training starts from and ends with: scaled samples, a split, random streams; a planner and its record."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F
from tqdm import tqdm

from moe_policy.learning.architectures import layer_sizes
from moe_policy.learning.fitting import Split, TrainingSettings, generator_for, mean_loss, minimise
from moe_policy.planners.network import NetworkPlanner
from moe_policy.planners.networks import Mixing, MixtureOfExperts, SingleNetwork
from moe_policy.planners.record import PartReport, TrainingReport
from moe_policy.planners.scaling import Standardizer, blocks
from ocp_envs.data.samples import Samples, SampleSource, samples_of
from ocp_envs.problem import OptimalControlProblem
from ocp_envs.support import scratch
from ocp_envs.support.provenance import peak_memory_gb

# Numbers of the random streams: the part, then the purpose. A single network and a first expert share theirs, so that a
# mixture of one expert is the single network.
GATE, FIRST = 0, 1
_WEIGHTS, _ORDER = 0, 1


@dataclass(frozen=True, eq=False)
class Part:
    """The training of one network on its own, which any process can do.

    Args:
        name: of the part, for the record.
        sizes: layer sizes.
        stream: number of its random streams.
        x: standardised p of its rows, float32.
        y: wanted outputs of the rows: standardised flat trajectories, or classes (int64), which make it a gate.
        split: which of the rows train and which test.
        settings, seed: of the training.
        checkpoint: file of its state, for :func:`~moe_policy.learning.fitting.minimise`.
    """

    name: str
    sizes: tuple[int, ...]
    stream: int
    x: NDArray[np.float32]
    y: NDArray[Any]
    split: Split
    settings: TrainingSettings
    seed: int
    checkpoint: Path | None = None


def train_part(part: Part, progress: bool | None = None) -> tuple[SingleNetwork, PartReport]:
    """Train the network of ``part``; ``progress`` shows a bar, by default on a terminal."""
    network = SingleNetwork(part.sizes, generator_for(part.seed, part.stream, _WEIGHTS))
    x, y = torch.from_numpy(part.x), torch.from_numpy(part.y)
    gate = not y.is_floating_point()
    loss: Callable[[Tensor, Tensor], Tensor] = F.cross_entropy if gate else F.smooth_l1_loss
    report = minimise(
        list(network.parameters()),
        lambda inputs, outputs, epoch: loss(network(inputs), outputs),
        x,
        y,
        part.split,
        name=part.name,
        batch=part.settings.gate_batch if gate else part.settings.batch,
        settings=part.settings,
        generator=generator_for(part.seed, part.stream, _ORDER),
        progress=progress,
        checkpoint=part.checkpoint,
    )
    if not gate:
        return network, report

    def correct(inputs: Tensor, classes: Tensor, epoch: int) -> Tensor:
        return (network(inputs).argmax(dim=1) == classes).double().mean()

    return network, dataclasses.replace(report, accuracy=mean_loss(correct, x, y, part.split.test, 0))


def _in_worker(part: Part) -> tuple[dict[str, NDArray[Any]], PartReport]:
    """:func:`train_part` with one thread and weights as arrays, which travel between processes."""
    torch.set_num_threads(1)
    network, report = train_part(part, progress=False)
    return {key: value.numpy() for key, value in network.state_dict().items()}, report


def train_parts(parts: Sequence[Part], executor: Executor | None = None) -> list[tuple[SingleNetwork, PartReport]]:
    """Train all ``parts``, here one after the other or on an executor; the results are the same.

    Args:
        parts: what to train.
        executor: any ``concurrent.futures`` executor of processes; ``None`` trains in this process.
    """
    if executor is None:
        return [train_part(part) for part in parts]
    # The largest first: the others fill the gaps.
    order = sorted(range(len(parts)), key=lambda i: -len(parts[i].x) * sum(parts[i].sizes))
    futures: dict[Future[tuple[dict[str, NDArray[Any]], PartReport]], int] = {}
    for i in order:
        futures[executor.submit(_in_worker, parts[i])] = i
    trained: dict[int, tuple[SingleNetwork, PartReport]] = {}
    for future in tqdm(as_completed(futures), total=len(parts), desc="networks", disable=None, leave=False):
        i = futures[future]
        weights, report = future.result()
        network = SingleNetwork(parts[i].sizes)
        network.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
        trained[i] = network, report
    return [trained[i] for i in range(len(parts))]


#: The rows of an array that is too large to be held in double precision: rows → values (B, n).
_Read = Callable[[Any], NDArray[np.float64]]


def _fitted(read: _Read, rows: NDArray[np.int64]) -> Standardizer:
    return Standardizer.fit_blocks(lambda: (read(rows[part]) for part in blocks(len(rows))))


def _scaled(scaler: Standardizer, read: _Read, count: int) -> Tensor:
    """All rows, standardised, in single precision."""
    scaled = scratch.empty((count, len(scaler)), np.float32)
    for part in blocks(count):
        scaled[part] = scaler.scale(read(part))
    return torch.from_numpy(scaled)


def _rows(x: Tensor, y: Tensor, split: Split) -> tuple[NDArray[np.float32], NDArray[Any], Split]:
    """The rows of a split alone, and the split of these rows; no copy where these are all."""
    if len(split.training) + len(split.test) == len(x):
        return x.numpy(), y.numpy(), split
    rows, place = np.unique(np.concatenate([split.training, split.test]), return_inverse=True)
    cut = len(split.training)
    return x[rows].numpy(), y[rows].numpy(), Split(place[:cut], place[cut:])


@dataclass(frozen=True, eq=False)
class Prepared:
    """Samples made ready for a training.

    Args:
        problem, settings, seed: of the training.
        split: which rows train and which test.
        inputs, outputs: scalers of p and of flat trajectories.
        x, y: standardised p (M, np) and flat trajectories (M, flat_size), float32; in files where they are large
            (:mod:`ocp_envs.support.scratch`), so that a training reads its minibatches from disk.
        checkpoints: folder of this training's checkpoints; none are written without one.
    """

    problem: OptimalControlProblem
    settings: TrainingSettings
    seed: int
    split: Split
    inputs: Standardizer
    outputs: Standardizer
    x: Tensor
    y: Tensor
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
        """Prepare a database; ``scalers`` (inputs, outputs) replace those of the training split."""
        samples = samples_of(database)
        count = len(samples.parameters)
        split = Split.draw(count, settings.test_share, seed)

        def parameters(rows: Any) -> NDArray[np.float64]:
            return samples.parameters[rows]

        def flat(rows: Any) -> NDArray[np.float64]:
            return samples.trajectory[rows].flat()

        inputs, outputs = scalers or (_fitted(parameters, split.training), _fitted(flat, split.training))
        x, y = _scaled(inputs, parameters, count), _scaled(outputs, flat, count)
        return cls(samples.problem, settings, seed, split, inputs, outputs, x, y, checkpoints)

    def network(self, hidden: Sequence[int], part: int, outputs: int | None = None) -> SingleNetwork:
        """A network with random weights from p to a flat trajectory, or to ``outputs`` logits."""
        sizes = layer_sizes(self.problem, tuple(hidden), outputs)
        return SingleNetwork(sizes, generator_for(self.seed, part, _WEIGHTS))

    def order(self, part: int) -> torch.Generator:
        """The random order of minibatches."""
        return generator_for(self.seed, part, _ORDER)

    def checkpoint(self, name: str) -> Path | None:
        """The file of the part called ``name``."""
        return None if self.checkpoints is None else self.checkpoints / f"{name.replace(' ', '-')}.pt"

    def regressor(self, hidden: Sequence[int], split: Split, name: str, part: int) -> Part:
        """The training of a network that predicts the trajectories of ``split``."""
        sizes = layer_sizes(self.problem, tuple(hidden))
        rows = _rows(self.x, self.y, split)
        return Part(name, sizes, part, *rows, self.settings, self.seed, self.checkpoint(name))

    def classifier(self, hidden: Sequence[int], classes: NDArray[np.int64], count: int, name: str, part: int) -> Part:
        """The training of a network that predicts which of ``count`` classes (M,) every p belongs to."""
        sizes = layer_sizes(self.problem, tuple(hidden), count)
        wanted = torch.from_numpy(np.array(classes))
        rows = _rows(self.x, wanted, self.split)
        return Part(name, sizes, part, *rows, self.settings, self.seed, self.checkpoint(name))

    def planner(
        self,
        name: str,
        network: SingleNetwork | MixtureOfExperts,
        mixing: Mixing,
        parts: Sequence[PartReport],
        **details: Any,
    ) -> NetworkPlanner:
        """The trained planner with its record, to which ``details`` are added."""
        mixed = isinstance(network, MixtureOfExperts)

        def loss(x: Tensor, y: Tensor, epoch: int) -> Tensor:
            return F.smooth_l1_loss(network(x, mixing) if mixed else network(x), y)

        report = TrainingReport(tuple(parts), mean_loss(loss, self.x, self.y, self.split.test, 0))
        record = {
            "seed": self.seed,
            "samples": len(self.x),
            "settings": dataclasses.asdict(self.settings),
            **details,
            "training": report.summary() | {"peak_memory_gb": peak_memory_gb()},
        }
        return NetworkPlanner(self.problem, name, network, self.inputs, self.outputs, mixing, record, report)
