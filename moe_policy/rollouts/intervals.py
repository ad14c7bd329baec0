"""Estimates with their 95 % confidence intervals: of a fraction, of a mean, and over training seeds.

Each class reads and writes its JSON object, ``from_json`` and ``to_json``, including the values that are derived;
reading raises a ``ValueError`` where the content is no such object.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest
from scipy.stats import t as student

from ocp_envs.support.doors import checked

Json = dict[str, object]
Interval = tuple[float, float]


class Estimate:
    """A fraction or a mean, with the bounds of its interval in ``interval``."""

    if TYPE_CHECKING:  # a property of one class, a field of the other

        @property
        def interval(self) -> Interval: ...

    @classmethod
    def from_json(cls, content: object) -> Estimate:
        """The :class:`Proportion` or the :class:`Mean` whose JSON is ``content``."""
        return (Proportion if isinstance(content, dict) and "count" in content else Mean).from_json(content)


@checked
@dataclass(frozen=True)
class Proportion(Estimate):
    """A fraction of cases, with the Wilson interval at 95 % confidence.

    The interval is that of Wilson, *Probable inference, the law of succession, and statistical inference* (1927). It
    lies inside [0, 1] and is informative for 0 and for all cases, too.

    Args:
        count: cases that are counted.
        total: all cases, at least one.

    Raises:
        ValueError: more cases are counted than there are, or there are none.
    """

    count: int
    total: int

    def __post_init__(self) -> None:
        if not 0 <= self.count <= self.total or self.total == 0:
            raise ValueError(f"expected 0 ≤ count ≤ total and total > 0, got {self.count} of {self.total}")

    @classmethod
    def of(cls, flags: NDArray[np.bool_]) -> Self:
        """The fraction of ``flags`` (B,) that are set."""
        return cls(int(np.count_nonzero(flags)), len(flags))

    @property
    def fraction(self) -> float:
        return self.count / self.total

    @property
    def interval(self) -> Interval:
        interval = binomtest(self.count, self.total).proportion_ci(0.95, method="wilson")
        return float(interval.low), float(interval.high)

    def to_json(self) -> Json:
        return {"count": self.count, "total": self.total, "fraction": self.fraction, "interval": list(self.interval)}

    @classmethod
    def from_json(cls, content: object) -> Self:
        known = _checked(content, {"count": int, "total": int, "fraction": float, "interval": list})
        return cls(known["count"], known["total"])


@checked
@dataclass(frozen=True)
class Mean(Estimate):
    """A mean of values that are not negative, with Student's interval at 95 % confidence.

    Args:
        mean: m, the mean of the finite values.
        total: n, the number of finite values.
        interval: m ± t_{0.975, n−1} s / √n, cut at 0; m ± m for a single value.
    """

    mean: float
    total: int
    interval: Interval

    @classmethod
    @checked
    def of(cls, values: ArrayLike) -> Self | None:
        """The mean of the finite ones among ``values`` (n,) ≥ 0; ``None`` where there are none."""
        table = np.asarray(values, dtype=np.float64)
        finite = table[np.isfinite(table)]
        if len(finite) == 0:
            return None
        mean = float(finite.mean())
        reach = _reach(finite) if len(finite) > 1 else mean
        return cls(mean, len(finite), (max(mean - reach, 0.0), mean + reach))

    def to_json(self) -> Json:
        return asdict(self) | {"interval": list(self.interval)}

    @classmethod
    def from_json(cls, content: object) -> Self:
        known = _checked(content, {"mean": float, "total": int, "interval": list})
        return cls(known["mean"], known["total"], _interval(known["interval"]))


def disjoint(one: Estimate, other: Estimate) -> bool:
    """Whether the intervals of ``one`` and ``other`` have no point in common."""
    (low, high), (lower, higher) = one.interval, other.interval
    return high < lower or higher < low


@dataclass(frozen=True)
class Spread:
    """A metric over n training seeds: its values, their median and range, and their mean.

    The range encloses the median of all seeds with probability 1 − 2^(1 − n) whatever the distribution (order
    statistics): 75 % for three seeds, 94 % for five. A bootstrap of so few values would claim 95 % without resampling
    anything new.

    Args:
        values: one a seed, finite, at least one.
        mean_interval: of the mean; ``None`` for a single seed. :meth:`of` computes it.

    Raises:
        ValueError: no values, or one that is not finite.
    """

    values: tuple[float, ...]
    mean_interval: Interval | None

    def __post_init__(self) -> None:
        if not self.values or not np.isfinite(self.values).all():
            raise ValueError(f"expected a finite metric for each of at least one seed, got {self.values}")

    @classmethod
    def of(cls, values: Iterable[float], bounds: Interval = (-np.inf, np.inf)) -> Self:
        """The spread of ``values``, one a seed, with Student's interval of the mean at 95 %, cut at ``bounds``."""
        known = tuple(float(value) for value in values)
        if len(known) < 2:
            return cls(known, None)
        mean, reach = np.mean(known), _reach(np.array(known))
        low, high = np.clip([mean - reach, mean + reach], *bounds)
        return cls(known, (float(low), float(high)))

    @property
    def median(self) -> float:
        return float(np.median(self.values))

    @property
    def minimum(self) -> float:
        return min(self.values)

    @property
    def maximum(self) -> float:
        return max(self.values)

    @property
    def coverage(self) -> float:
        """Probability that minimum and maximum enclose the median of all seeds."""
        return float(1 - 2.0 ** (1 - len(self.values)))

    def to_json(self) -> Json:
        """The values, and all that is derived from them; minimum and maximum as ``least`` and ``most``."""
        return {
            "values": list(self.values),
            "median": self.median,
            "least": self.minimum,
            "most": self.maximum,
            "coverage": self.coverage,
            "mean": float(np.mean(self.values)),
            "mean_interval": None if self.mean_interval is None else list(self.mean_interval),
        }

    @classmethod
    def from_json(cls, content: object) -> Self:
        floats = dict.fromkeys(("median", "least", "most", "coverage", "mean"), float)
        known = _checked(content, {"values": list} | floats | {"mean_interval": (list, type(None))})
        interval = known["mean_interval"]
        return cls(tuple(known["values"]), None if interval is None else _interval(interval))


def _reach(values: NDArray[np.float64]) -> float:
    """Half the width of Student's interval at 95 % of the mean of ``values`` (n,), n ≥ 2."""
    n = len(values)
    return float(student.ppf(0.975, n - 1)) * float(values.std(ddof=1)) / float(n**0.5)


def _interval(ends: list[float]) -> Interval:
    low, high = ends
    return low, high


def _checked(content: object, kinds: Mapping[str, type | tuple[type, ...]]) -> dict[str, Any]:
    whole = isinstance(content, dict) and content.keys() == kinds.keys()
    if isinstance(content, dict) and whole and all(isinstance(content[key], kind) for key, kind in kinds.items()):
        return content
    raise ValueError(f"got {content!r}, expected an object with the keys {', '.join(kinds)}")
