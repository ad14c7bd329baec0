"""Trajectories of fixed-point numbers, whose files take half the space of half precision.

Each state, each control and the duration is a whole multiple of a unit of its own, a power of two. The unit is about a
part in 4096 of the range of all values and 0 (which has 2896 to 5793 units), so rounding changes a value by at most one
part in 5792 of the range; half precision changes large values as much.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from moe_policy.model_files import Tensors
from ocp_envs.support.arrays import Array
from ocp_envs.support.packing import pack, unpack
from ocp_envs.trajectory import Trajectory

#: About how many units the range of a coordinate has, and the largest number of units of a number that is packed.
LEVELS, LARGEST = 4096, 2**20


def rounded(trajectory: Trajectory) -> Trajectory:
    """The ``trajectory`` with all values rounded to fixed-point numbers."""
    parts = {}
    for name, values in _parts(trajectory).items():
        lowest, highest = (bound(axis=(0, 1), initial=0.0) for bound in (values.min, values.max))
        range_ = highest - lowest
        units = np.exp2(np.round(np.log2(np.where(range_ > 0, range_ / LEVELS, 1.0))))
        parts[name] = np.rint(values / units) * units
    return _joined(parts)


def packed(trajectory: Trajectory) -> Tensors | None:
    """The ``trajectory`` as tensors, without any loss; ``None`` where its values are no :func:`rounded` ones."""
    tensors: dict[str, NDArray[np.generic]] = {}
    if not trajectory.finite.all():
        return None
    for name, values in _parts(trajectory).items():
        units = _units(values)
        with np.errstate(over="ignore"):
            numbers = values / units
        if np.abs(numbers).max(initial=0) > LARGEST:
            return None
        tensors |= {name: np.frombuffer(pack(numbers.astype(np.int64)), np.uint8), f"{name}.unit": units}
    return tensors


def unpacked(tensors: Tensors) -> Trajectory:
    """The trajectory of which :func:`packed` made ``tensors``.

    Raises:
        DamagedFileError: the tensors are damaged.
        KeyError: one is missing.
    """
    parts = {}
    for name in ("states", "controls", "duration"):
        units = tensors[f"{name}.unit"].astype(np.float64)
        parts[name] = unpack(tensors[name].tobytes()).astype(np.float64) * units
    return _joined(parts)


def _parts(trajectory: Trajectory) -> Mapping[str, Array]:
    """States (B, N, nx), controls (B, N-1, nu) and duration (B, 1, 1) of a ``trajectory``."""
    duration = trajectory.duration[:, None, None]
    return {"states": trajectory.states, "controls": trajectory.controls, "duration": duration}


def _joined(parts: Mapping[str, Array]) -> Trajectory:
    """The trajectory of such ``parts``."""
    return Trajectory(parts["states"], parts["controls"], parts["duration"][:, 0, 0])


def _units(values: Array) -> Array:
    """The largest power of two of which all ``values`` (B, N, c) of a coordinate are multiples, (c,), 1 for zeros."""
    mantissa, exponent = np.frexp(values)
    whole = (mantissa * 2.0**53).astype(np.int64)
    lowest = np.ldexp((whole & -whole).astype(np.float64), exponent - 53)
    units = np.where(values == 0, np.inf, lowest).min(axis=(0, 1), initial=np.inf)
    return np.where(np.isfinite(units), units, 1.0)
