"""Calculation with PyTorch in single precision on the processor, whatever the global settings of a program.

The default dtype and the default device are named where tensors are made. Autocast, and the modes in which no gradients
are recorded, are left here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

#: Type and place of weights and training data.
DTYPE, DEVICE = torch.float32, torch.device("cpu")


@contextmanager
def planning() -> Iterator[None]:
    """A context without gradients, and without autocast to half precision."""
    with torch.inference_mode(), torch.autocast(DEVICE.type, enabled=False):
        yield


@contextmanager
def training() -> Iterator[None]:
    """A context with gradients, also where the caller records none, and without autocast."""
    with torch.inference_mode(False), torch.enable_grad(), torch.autocast(DEVICE.type, enabled=False):
        yield
