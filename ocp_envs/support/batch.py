"""Batched, copy-free evaluation of CasADi functions on NumPy arrays.

CasADi's matrices are column-major and ``Function.map(B)`` lays the B columns side by side, so a C-contiguous (B, n)
array *is* the memory of its (n, B) argument: evaluation is one call without conversion, about a microsecond for B = 1.
From :data:`KERNEL_ROWS` rows on, compiled kernels evaluate many rows at once (:mod:`ocp_envs.support.kernels`), where
there is a compiler. Which of the two evaluates depends on the number of rows alone.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import cast

import casadi as ca
import numpy as np

from ocp_envs.support.arrays import Array, pointers
from ocp_envs.support.checks import check_whole
from ocp_envs.support.doors import checked
from ocp_envs.support.kernels import Entry, kernel
from ocp_envs.support.kinds import AnyFloat

_KEPT_SIZES = 8
#: Rows of a bound function, whose arrays stay in memory.
MOST_ROWS = 10**7
#: From so many rows on, a compiled kernel evaluates. Compiling takes up to a second, once.
KERNEL_ROWS = 32


def dense_function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """The function ``name`` from the symbols ``inputs`` to the expressions ``outputs`` of them, made dense.

    :class:`BatchFunction` needs this: structural zeros have no memory.
    """
    return ca.Function(name, inputs, [ca.densify(output) for output in outputs])


class _Buffers(threading.local):
    """Buffers of one function by size of the batch, the one used least recently first; each thread has its own.

    CasADi reads and writes through the pointers of a buffer while other Python threads run.
    """

    def __init__(self) -> None:
        self.by_size: OrderedDict[int, tuple[ca.FunctionBuffer, Callable[[], None]]] = OrderedDict()


class BatchFunction:
    """A dense CasADi function on a leading batch axis.

    Arguments and results have shape (B, rows) for column vectors and (B, rows, columns) for matrices. Results are new
    arrays on each call. Threads may share it, and it may be copied and pickled. From ``kernel_rows`` rows on, the
    compiled ``function`` is evaluated.
    """

    @checked
    def __init__(self, function: ca.Function, kernel_rows: AnyFloat = KERNEL_ROWS) -> None:
        for i in range(function.n_out()):
            if not function.sparsity_out(i).is_dense():
                raise ValueError(f"{function.name()}: output {i} is sparse; build it with dense_function")
        self.function, self.kernel_rows = function, kernel_rows
        self._in = [function.size_in(i) for i in range(function.n_in())]
        self._out = [function.size_out(i) for i in range(function.n_out())]
        self._buffers = _Buffers()

    def __reduce__(self) -> tuple[object, ...]:
        return BatchFunction, (self.function, self.kernel_rows)

    @cached_property
    def _kernel(self) -> Entry | None:
        return kernel(self.function)

    def _buffer(self, size: int) -> tuple[ca.FunctionBuffer, Callable[[], None]]:
        buffers = self._buffers.by_size
        if size in buffers:
            buffers.move_to_end(size)
        else:
            mapped = self.function if size == 1 else self.function.map(size)
            buffers[size] = mapped.buffer()
            if len(buffers) > _KEPT_SIZES:
                buffers.popitem(last=False)
        return buffers[size]

    def bind(self, size: int) -> BoundFunction:
        """The function on ``size`` rows with arrays of its own, for callers that step in place."""
        return BoundFunction(self.function, size, self.kernel_rows)

    def __call__(self, *arguments: Array) -> list[Array]:
        if len(arguments) != len(self._in):
            raise TypeError(f"{self.function.name()} takes {len(self._in)} arguments, got {len(arguments)}")
        size = len(arguments[0])
        if size == 0:
            return [np.empty((0, rows) if columns == 1 else (0, rows, columns)) for rows, columns in self._out]
        held, results = self._held(size, arguments), self._empty(size)
        compiled = self._kernel if size >= self.kernel_rows else None
        if compiled is not None:
            compiled(size, pointers(held), pointers(results))
        else:
            self._interpret(size, held, results)
        return [result if columns == 1 else result.swapaxes(-1, -2) for result, (_, columns) in zip(results, self._out)]

    def _held(self, size: int, arguments: Sequence[Array]) -> list[Array]:
        """The ``arguments`` of ``size`` rows in the memory that CasADi expects."""
        held = []
        for i, (argument, (rows, columns)) in enumerate(zip(arguments, self._in)):
            array = np.ascontiguousarray(argument, dtype=np.float64)
            if array.size != size * rows * columns:
                expected = (size, rows) if columns == 1 else (size, rows, columns)
                raise ValueError(f"{self.function.name()}: argument {i} has shape {array.shape}, expected {expected}")
            held.append(array if columns == 1 else np.ascontiguousarray(array.swapaxes(-1, -2)))
        return held

    def _empty(self, size: int) -> list[Array]:
        """Arrays for the results of ``size`` rows, in the memory that CasADi expects."""
        return [np.empty((size, rows) if columns == 1 else (size, columns, rows)) for rows, columns in self._out]

    def _interpret(self, size: int, arguments: Sequence[Array], results: Sequence[Array]) -> None:
        buffer, trigger = self._buffer(size)
        for i, array in enumerate(arguments):
            buffer.set_arg(i, memoryview(array.data))
        for i, array in enumerate(results):
            buffer.set_res(i, memoryview(array.data))
        trigger()


@checked
@dataclass(frozen=True, eq=False)
class Linearisation:
    """The function (x, u, …) → A (B, nx, nx), B (B, nx, nu) of the ``jacobian`` (x, u, …) → [A B] (B, nx, nx + nu)."""

    jacobian: BatchFunction

    def __call__(self, x: Array, u: Array, *arguments: Array) -> tuple[Array, Array]:
        """A and B at ``x`` (B, nx), ``u`` (B, nu) and further ``arguments``."""
        (both,) = self.jacobian(x, u, *arguments)
        return both[:, :, : x.shape[1]], both[:, :, x.shape[1] :]


class BoundFunction:
    """A dense CasADi function of column vectors on a fixed number of rows, evaluated in place.

    Write into ``inputs``, call the object, read ``outputs``: lists of arrays of shape (size, rows) that are the
    function's own memory and are overwritten by the next call. Two bound functions share nothing; copying and pickling
    carry the values over. This is what makes stepping a single environment as cheap as a Python call. From
    ``kernel_rows`` rows on, the compiled ``function`` is evaluated.
    """

    @checked
    def __init__(self, function: ca.Function, size: int, kernel_rows: AnyFloat = KERNEL_ROWS) -> None:
        check_whole("size", size, 1, MOST_ROWS)
        self.function, self.size, self.kernel_rows = function, size, kernel_rows
        self.inputs = [np.zeros((size, function.size1_in(i))) for i in range(function.n_in())]
        self.outputs = [np.zeros((size, function.size1_out(i))) for i in range(function.n_out())]
        compiled = kernel(function) if size >= kernel_rows else None
        self._trigger = self._interpreted() if compiled is None else self._compiled(compiled)

    # Both hold bare pointers: they and the arrays must live as long as the trigger.

    def _interpreted(self) -> Callable[[], None]:
        mapped = self.function if self.size == 1 else self.function.map(self.size)
        self._buffer, trigger = mapped.buffer()
        for i, array in enumerate(self.inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)
        return cast("Callable[[], None]", trigger)

    def _compiled(self, compiled: Entry) -> Callable[[], None]:
        return partial(compiled, self.size, pointers(self.inputs), pointers(self.outputs))

    def __call__(self) -> None:
        self._trigger()

    def __reduce__(self) -> tuple[object, ...]:
        return _rebind, (self.function, self.size, self.kernel_rows, self.inputs, self.outputs)


def _rebind(
    function: ca.Function, size: int, kernel_rows: float, inputs: list[Array], outputs: list[Array]
) -> BoundFunction:
    bound = BoundFunction(function, size, kernel_rows)
    for own, values in zip(bound.inputs + bound.outputs, inputs + outputs):
        own[:] = values
    return bound
