"""Batches: frozen dataclasses whose arrays hold one row per element, selected and joined field by field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ocp_envs.support.arrays import Bools, Ints

#: What selects rows: an integer, a slice, a mask or an array of integers.
Rows = int | np.integer | slice | Bools | NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Batch:
    """Base of batches.

    A field that is an array or a batch itself has one row an element, along its first axis. Any other one, ``None``
    included, belongs to the batch as a whole.
    """

    def __init_subclass__(cls, **arguments: object) -> None:
        super().__init_subclass__(**arguments)
        # A dataclass would print all its arrays; it keeps a method that the class already has.
        cls.__repr__ = Batch.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        columns = self._columns().items()
        arrays = [f"{name} {column.shape}" for name, column in columns if isinstance(column, np.ndarray)]
        others = [f"{name} ({type(column).__name__})" for name, column in columns if isinstance(column, Batch)]
        return f"<{type(self).__name__} of {len(self)}: {', '.join(arrays + others)}>"

    def __post_init__(self) -> None:
        rows = set()
        for name, value in vars(self).items():
            if isinstance(value, list):  # a column, not a value of the batch as a whole
                value = np.asarray(value)
                object.__setattr__(self, name, value)
            if isinstance(value, (np.ndarray, Batch)):
                rows.add(len(value) if isinstance(value, Batch) or value.ndim else None)
        if len(rows) > 1 or None in rows:
            shapes = ", ".join(
                f"{name} {c.shape if isinstance(c, np.ndarray) else len(c)}" for name, c in self._columns().items()
            )
            raise ValueError(f"{type(self).__name__}: expected arrays with equal numbers of rows, got {shapes}")

    def __array__(self, *arguments: object, **named: object) -> NDArray[np.generic]:
        # NumPy would take it for a sequence of sequences without end: an element is a batch, too.
        raise TypeError(f"a {type(self).__name__} is no array; take one of its arrays: {', '.join(self._columns())}")

    def __len__(self) -> int:
        return len(next(iter(self._columns().values())))

    def __getitem__(self, rows: Rows) -> Self:
        """The elements at ``rows``; an integer keeps the batch axis."""
        if isinstance(rows, (int, np.integer)):
            rows = slice(int(rows), int(rows) + 1 or None)
        return replace(self, **{name: column[rows] for name, column in self._columns().items()})

    def replaced(self, rows: Bools, new: Self) -> Self:
        """This batch with the elements of the mask ``rows`` (B,) taken from ``new``, in order."""
        given = new._columns()
        return replace(self, **{name: _put(column, rows, given[name]) for name, column in self._columns().items()})

    def replaced_at(self, rows: Ints, new: Self) -> Self:
        """This batch with the elements at the different ``rows`` (M,) taken from ``new``, M of them in that order."""
        mask = np.zeros(len(self), dtype=bool)
        mask[rows] = True
        return self.replaced(mask, new[np.argsort(rows)])

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """The elements of all ``parts``, at least one, in order; other fields are those of the first."""
        columns = [part._columns() for part in parts]
        return replace(parts[0], **{name: _join([each[name] for each in columns]) for name in columns[0]})

    def _columns(self) -> dict[str, Column]:
        """The fields that have rows, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, (np.ndarray, Batch))}


Column = NDArray[np.generic] | Batch


def _put(column: Column, rows: Bools, new: Column) -> Column:
    if isinstance(column, Batch) and isinstance(new, Batch):
        return column.replaced(rows, new)
    changed = np.array(column)
    changed[rows] = new
    return changed


def _join(parts: Sequence[Column]) -> Column:
    if isinstance(parts[0], Batch):
        return type(parts[0]).concatenate(parts)  # type: ignore[arg-type]
    return np.concatenate(parts)
