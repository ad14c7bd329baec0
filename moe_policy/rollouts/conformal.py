"""Bounds on how a planner performs on fresh instances that hold whatever the distribution of its results.

They are calibrated on n instances that were drawn as the fresh ones will be, and that no choice was made on.

The split-conformal bound (Vovk, Gammerman & Shafer, *Algorithmic Learning in a Random World*, 2005; Lei et al.,
*Distribution-free predictive inference for regression*, 2018): of n + 1 exchangeable values, the last one is at most
the k-th smallest of the others, k = ⌈(n + 1) · level⌉, with a probability of at least ``level``. The probability is
over the calibration as well; for one calibration the fraction of fresh values below the bound has the distribution
Beta(k, n + 1 − k), if no values are equal. A success rate has the lower bound of Clopper & Pearson (1934).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta

from ocp_envs.support.arrays import Bools


def upper_bound(values: ArrayLike, level: float = 0.95) -> float:
    """What a fresh value does not exceed with a probability of at least ``level``, from calibration ``values`` (n,).

    It is +inf where n is too small for the level, n + 1 < 1 / (1 − level), or where too many values are +inf.

    Raises:
        ValueError: values of another shape, or NaN; or a level outside (0, 1).
    """
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 1 or np.isnan(table).any():
        raise ValueError(f"values: expected (n,) without NaN, got the shape {table.shape}")
    rank = _rank(len(table), level)
    return float(np.sort(table)[rank - 1]) if rank <= len(table) else math.inf


def coverage_range(count: int, level: float = 0.95, confidence: float = 0.95) -> tuple[float, float]:
    """Between which fractions of fresh values are below the bound, for ``confidence`` of all calibrations.

    There are ``count`` calibration values and the bound has the ``level``. The upper end is 1 where the bound is +inf.

    Raises:
        ValueError: a level or a confidence outside (0, 1).
    """
    rank = _rank(count, level)
    _check_fraction("confidence", confidence)
    if rank > count:
        return 1.0, 1.0
    low, high = beta.ppf([(1 - confidence) / 2, (1 + confidence) / 2], rank, count + 1 - rank)
    return float(low), float(high)


def least_success(flags: Bools, confidence: float = 0.95) -> float:
    """What the probability of success exceeds with ``confidence``, from calibration ``flags`` (n,) of successes.

    Raises:
        ValueError: no flags, or a confidence outside (0, 1).
    """
    _check_fraction("confidence", confidence)
    count, total = int(np.count_nonzero(flags)), len(flags)
    if total == 0:
        raise ValueError("flags: expected at least one, got none")
    return float(beta.ppf(1 - confidence, count, total - count + 1)) if count else 0.0


def _rank(count: int, level: float) -> int:
    """⌈(n + 1) · level⌉ of ``count`` = n values; a product that is whole but for rounding stays so."""
    _check_fraction("level", level)
    return math.ceil((count + 1) * level - 1e-9)


def _check_fraction(name: str, value: float) -> None:
    if not 0 < value < 1:
        raise ValueError(f"{name}: expected a number in (0, 1), got {value}")
