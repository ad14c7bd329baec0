"""How a planner was trained: the record that travels with its weights."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from ocp_envs.support.doors import checked
from ocp_envs.support.kinds import AnyFloat


@checked
@dataclass(frozen=True)
class PartReport:
    """The training of one network, or of a whole mixture at once.

    Args:
        name: ``"single"``, ``"gate"``, ``"expert 0"`` …, ``"mixture"``.
        training_samples: size of its training split.
        test_samples: size of its test split.
        training_losses: mean loss over the training split of every epoch, while the weights change.
        test_losses: mean loss over the test split after every epoch.
        best_epoch: the epoch (from 0) whose weights were kept.
        test_loss: their loss on the test split: smooth L1 on standardised outputs, cross entropy for a gate.
        seconds: wall time of its epochs.
        accuracy: a gate's fraction of correct choices on the test split.
    """

    name: str
    training_samples: int
    test_samples: int
    training_losses: tuple[AnyFloat, ...]
    test_losses: tuple[AnyFloat, ...]
    best_epoch: int
    test_loss: AnyFloat
    seconds: float
    accuracy: AnyFloat | None = None

    @property
    def epochs(self) -> int:
        """Epochs that were run."""
        return len(self.test_losses)

    def summary(self) -> dict[str, object]:
        """The record without its curves."""
        record = asdict(self)
        del record["training_losses"], record["test_losses"]
        return record | {"epochs": self.epochs}


@checked
@dataclass(frozen=True)
class TrainingReport:
    """All ``parts`` of one training, in order, and the ``test_error`` of the finished planner: smooth L1 on
    standardised outputs of the test split.
    """

    parts: tuple[PartReport, ...]
    test_error: AnyFloat

    @property
    def seconds(self) -> float:
        """Wall time of all parts."""
        return sum(part.seconds for part in self.parts)

    def part(self, name: str) -> PartReport:
        """The part called ``name``."""
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(f"no part {name!r}; there are {[part.name for part in self.parts]}")

    def summary(self) -> dict[str, object]:
        """The record that is saved with a model, as JSON."""
        parts = [part.summary() for part in self.parts]
        return {"test_error": self.test_error, "seconds": self.seconds, "parts": parts}
