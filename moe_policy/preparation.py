"""What every training starts from and ends with: scaled samples, a split, random streams; a planner and its record."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from moe_policy.architectures import layer_sizes
from moe_policy.clustering import Samples, SampleSource, samples_of
from moe_policy.fitting import PartReport, Split, TrainingReport, TrainingSettings, generator_for, minimise
from moe_policy.networks import Mixing, MixtureOfExperts, SingleNetwork
from moe_policy.planner import NetworkPlanner
from moe_policy.scaling import Standardizer
from ocp_envs.problem import OptimalControlProblem

# Numbers of the random streams: the part, then the purpose. A single network and a first expert share theirs, so that a
# mixture of one expert is the single network.
GATE, FIRST = 0, 1
_WEIGHTS, _ORDER = 0, 1


@dataclass(frozen=True, eq=False)
class Prepared:
    """Samples made ready for a training.

    Args:
        problem, settings, seed: of the training.
        split: which rows train and which test.
        inputs, outputs: scalers of p and of flat trajectories.
        x, y: standardised p (M, np) and flat trajectories (M, flat_size), float32.
    """

    problem: OptimalControlProblem
    settings: TrainingSettings
    seed: int
    split: Split
    inputs: Standardizer
    outputs: Standardizer
    x: Tensor
    y: Tensor

    @classmethod
    def of(
        cls,
        database: Samples | SampleSource,
        settings: TrainingSettings,
        seed: int,
        scalers: tuple[Standardizer, Standardizer] | None = None,
    ) -> Prepared:
        """Prepare a database; ``scalers`` (inputs, outputs) replace those of the training split."""
        samples = samples_of(database)
        p, flat = samples.parameters, samples.trajectory.flat()
        split = Split.draw(len(flat), settings.test_share, seed)
        rows = split.training
        inputs, outputs = scalers or (Standardizer.fit(p[rows]), Standardizer.fit(flat[rows]))
        x, y = (torch.from_numpy(scaled.astype(np.float32)) for scaled in (inputs.scale(p), outputs.scale(flat)))
        return cls(samples.problem, settings, seed, split, inputs, outputs, x, y)

    def network(self, hidden: Sequence[int], part: int, outputs: int | None = None) -> SingleNetwork:
        """A network with random weights from p to a flat trajectory, or to ``outputs`` logits."""
        sizes = layer_sizes(self.problem, tuple(hidden), outputs)
        return SingleNetwork(sizes, generator_for(self.seed, part, _WEIGHTS))

    def order(self, part: int) -> torch.Generator:
        """The random order of minibatches."""
        return generator_for(self.seed, part, _ORDER)

    def regress(self, network: SingleNetwork, split: Split, name: str, part: int) -> PartReport:
        """Train ``network`` to predict the trajectories of ``split``."""
        return minimise(
            list(network.parameters()),
            lambda x, y, epoch: F.smooth_l1_loss(network(x), y),
            self.x,
            self.y,
            split,
            name=name,
            batch=self.settings.batch,
            settings=self.settings,
            generator=self.order(part),
        )

    def planner(
        self,
        name: str,
        network: SingleNetwork | MixtureOfExperts,
        mixing: Mixing,
        parts: Sequence[PartReport],
        **details: Any,
    ) -> NetworkPlanner:
        """The trained planner with its record, to which ``details`` are added."""
        rows = self.split.test
        with torch.inference_mode():
            mixed = isinstance(network, MixtureOfExperts)
            predicted = network(self.x[rows], mixing) if mixed else network(self.x[rows])
            report = TrainingReport(tuple(parts), float(F.smooth_l1_loss(predicted, self.y[rows])))
        record = {
            "seed": self.seed,
            "samples": len(self.x),
            "settings": dataclasses.asdict(self.settings),
            **details,
            "training": report.summary(),
        }
        return NetworkPlanner(self.problem, name, network, self.inputs, self.outputs, mixing, record, report)
