"""Examples for a network: inputs, target outputs, and the split into a training and a test set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from moe_policy.planners.calculation import planning
from ocp_envs.support.arrays import Bools, Ints

#: (inputs, wanted outputs, epoch) → mean loss of the batch.
Loss = Callable[[Tensor, Tensor, int], Tensor]
#: Rows on which a loss is evaluated at once.
_BLOCK = 8192


@dataclass(frozen=True)
class Split:
    """Row numbers of the ``training`` and of the ``test`` samples."""

    training: Ints
    test: Ints

    @classmethod
    def draw(cls, count: int, test_share: float, seed: int) -> Split:
        """A random split of ``count`` ≥ 2 rows, the same for every model of one ``seed``: a fraction ``test_share`` of
        them tests, at least one row trains and one tests.
        """
        if count < 2:
            raise ValueError(f"a split into training and test needs at least two samples, got {count}")
        order = np.random.default_rng((seed, 0)).permutation(count)
        test = min(max(round(test_share * count), 1), count - 1)
        return cls(np.sort(order[test:]), np.sort(order[:test]))

    def within(self, rows: Bools) -> Split:
        """The split restricted to the rows of the mask ``rows``; where no test row is left, the training rows test."""
        training, test = self.training[rows[self.training]], self.test[rows[self.test]]
        return Split(training, test if len(test) else training)


@dataclass(frozen=True, eq=False)
class Examples:
    """Inputs ``x`` of a network, standardised p (M, np) in float32, and its wanted outputs ``y``, standardised flat
    trajectories (M, flat_size) in float32 or classes (M,) in int64; ``split`` says which rows train and which test.
    These are arrays, not tensors, so that they can go to another process.
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32] | Ints
    split: Split

    @property
    def classified(self) -> bool:
        """Whether the wanted outputs are classes."""
        return self.y.dtype.kind == "i"

    @property
    def tensors(self) -> tuple[Tensor, Tensor]:
        """The inputs and the wanted outputs, as tensors on the same memory."""
        return torch.from_numpy(self.x), torch.from_numpy(self.y)

    def compact(self) -> Examples:
        """The examples without rows that are in neither split; without a copy where there are none."""
        training, test = self.split.training, self.split.test
        if len(training) + len(test) == len(self.x):
            return self
        rows, place = np.unique(np.concatenate([training, test]), return_inverse=True)
        split = Split(place[: len(training)], place[len(training) :])
        return Examples(self.x[rows], self.y[rows], split)

    def with_further(self, rows: Ints, y: NDArray[np.float32]) -> Examples:
        """The examples and E more, with the inputs of ``rows`` (E,) and the wanted outputs ``y`` (E, n), at the end.

        They train where their row does, and test where it does.
        """
        own, more = self.split, np.arange(len(rows)) + len(self.x)
        tests = np.isin(rows, own.test)
        split = Split(np.concatenate([own.training, more[~tests]]), np.concatenate([own.test, more[tests]]))
        return Examples(np.concatenate([self.x, self.x[rows]]), np.concatenate([self.y, y]), split)

    def test_loss(self, loss: Loss, epoch: int = 0) -> float:
        """Mean of ``loss`` at ``epoch`` over the test split, without gradients."""
        (x, y), total = self.tensors, 0.0
        with planning():
            for rows in torch.from_numpy(self.split.test).split(_BLOCK):
                total += float(loss(x[rows], y[rows], epoch)) * len(rows)
        return total / len(self.split.test)
