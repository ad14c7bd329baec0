"""How networks are trained.

The learning rate of epoch e of E follows half a cosine,

    η_e = η (f + (1 − f) (1 + cos(π e / E)) / 2),   f = final_fraction; f = 1 is a constant rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ocp_envs.support.checks import check_number, check_whole


@dataclass(frozen=True)
class TrainingSettings:
    """How networks are trained; the same values serve single networks and mixtures.

    Args:
        epochs: maximum number of passes over the training split.
        patience: training stops after so many epochs without a lower test loss; ``None`` never stops early.
        batch: minibatch of regressors, samples.
        gate_batch: minibatch of gates, samples.
        learning_rate: Adam's step η.
        final_fraction: the final learning rate as a fraction f of η; 1 keeps it constant.
        test_share: fraction of the samples in the test split.

    Raises:
        TypeError: a value that is no number.
        ValueError: a value outside its range.
    """

    epochs: int = 2000
    patience: int | None = None
    batch: int = 64
    gate_batch: int = 64
    learning_rate: float = 1e-2
    final_fraction: float = 0.01
    test_share: float = 0.2

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "gate_batch", *(() if self.patience is None else ("patience",))):
            check_whole(name, getattr(self, name))
            object.__setattr__(self, name, int(getattr(self, name)))  # for records: NumPy's integers are no JSON
        for name in ("learning_rate", "final_fraction", "test_share"):
            check_number(name, getattr(self, name), "a finite number above 0", 0.0)
            object.__setattr__(self, name, float(getattr(self, name)))
        if self.final_fraction > 1:
            raise ValueError(f"final_fraction must lie in (0, 1], got {self.final_fraction}")
        if self.test_share >= 1:
            raise ValueError(f"test_share must lie in (0, 1), got {self.test_share}")

    @classmethod
    def paper(cls) -> TrainingSettings:
        """The settings printed by Tang & Hauser."""
        return cls(epochs=1500, patience=8, gate_batch=256, learning_rate=1e-3, final_fraction=1.0)

    def rate(self, epoch: int) -> float:
        """The learning rate η_e of ``epoch`` e, counted from 0."""
        f = self.final_fraction
        return self.learning_rate * (f + (1 - f) * (1 + math.cos(math.pi * epoch / self.epochs)) / 2)


#: The project's own settings.
DEFAULT = TrainingSettings()


@dataclass(frozen=True)
class Annealing:
    """ε of the softmax during joint training: geometric from ``start`` to ``end``, then constant.

    Only weights of the constant phase can be kept.

    Args:
        start: ε of the first epoch.
        end: ε of the constant phase.
        share: fraction of the epochs in which ε falls.

    Raises:
        TypeError: a value that is no number.
        ValueError: a value outside its range.
    """

    start: float = 1.0
    end: float = 0.01
    share: float = 0.8

    def __post_init__(self) -> None:
        for name in ("start", "end", "share"):
            check_number(name, getattr(self, name))
            object.__setattr__(self, name, float(getattr(self, name)))
        if not 0 < self.end <= self.start:
            raise ValueError(f"expected 0 < end ≤ start, got start {self.start} and end {self.end}")
        if not 0 <= self.share < 1:
            raise ValueError(f"share must lie in [0, 1), got {self.share}")

    def settled(self, epochs: int) -> int:
        """First epoch of the constant phase out of ``epochs``."""
        return int(self.share * epochs)

    def epsilon(self, epoch: int, epochs: int) -> float:
        """ε of ``epoch``, counted from 0, out of ``epochs``."""
        progress = min(epoch / max(self.settled(epochs), 1), 1.0)
        return float(self.start * (self.end / self.start) ** progress)


#: The project's own schedule.
DEFAULT_ANNEALING = Annealing()
