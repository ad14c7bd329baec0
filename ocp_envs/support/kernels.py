"""Compiled CasADi functions on many rows at once.

CasADi evaluates a mapped function row by row, instruction by instruction. A kernel is the same sequence of scalar
instructions as C on vectors of 8 rows (4 without AVX-512): one instruction of the processor works on a whole vector,
sines and their like are those of glibc's vector library, where there is one. Rows are always calculated in whole
vectors, so that a row does not depend on where it stands in its batch, nor on the batch.

Results agree with the interpreter's to the rounding of the elementary functions (4 units in the last place); what is
not finite there is not finite here.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import cast

import casadi as ca

from ocp_envs.support.compiler import NATIVE, compiled, written_by

#: Contractions would round differently in a vector and in the interpreter. The flags on errno and traps let the
#: compiler use the processor's square roots and roundings.
FLAGS = (
    "-O2",
    *NATIVE,
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-w",
)
#: Longer functions take too long to compile.
MOST_INSTRUCTIONS = 20_000

#: The C of an instruction from that of its arguments.
_EXPRESSIONS: Mapping[str, str] = MappingProxyType(
    {
        "ASSIGN": "{0}",
        "LIFT": "{0}",
        "ADD": "{0} + {1}",
        "SUB": "{0} - {1}",
        "MUL": "{0} * {1}",
        "DIV": "{0} / {1}",
        "NEG": "-{0}",
        "SQ": "{0} * {0}",
        "TWICE": "{0} + {0}",
        "INV": "all(1.0) / {0}",
        "LT": "truth({0} < {1})",
        "LE": "truth({0} <= {1})",
        "EQ": "truth({0} == {1})",
        "NE": "truth({0} != {1})",
        "NOT": "truth({0} == all(0.0))",
        "AND": "truth(({0} != all(0.0)) & ({1} != all(0.0)))",
        "OR": "truth(({0} != all(0.0)) | ({1} != all(0.0)))",
        "IF_ELSE_ZERO": "choose({0} != all(0.0), {1}, all(0.0))",
        "FMIN": "choose(({0} <= {1}) | ({1} != {1}), {0}, {1})",
        "FMAX": "choose(({0} >= {1}) | ({1} != {1}), {0}, {1})",
        "SIGN": "choose({0} < all(0.0), all(-1.0), choose({0} > all(0.0), all(1.0), {0}))",
        "FABS": "magnitude({0})",
    }
)
#: Instructions that are functions of C's mathematical library, of one argument and of two.
_OF_ONE = (
    *("EXP", "LOG", "SQRT", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "SINH", "COSH", "TANH"),
    *("ASINH", "ACOSH", "ATANH", "LOG1P", "EXPM1", "ERF", "FLOOR", "CEIL"),
)
_OF_TWO = ("POW", "FMOD", "COPYSIGN", "ATAN2", "HYPOT", "REMAINDER")
#: Those that glibc's vector library has, from the version of glibc on; but not its power, which is less exact.
_VECTOR = MappingProxyType(
    dict.fromkeys(("sin", "cos", "exp", "log"), "2, 22")
    | dict.fromkeys(("tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"), "2, 35")
    | dict.fromkeys(("log1p", "expm1", "erf", "atan2", "hypot"), "2, 35")
)
_NAMES = {getattr(ca, f"OP_{name}"): name for name in (*_EXPRESSIONS, *_OF_ONE, *_OF_TWO)}
_NAMES |= {ca.OP_CONSTPOW: "POW", ca.OP_CONST: "CONST", ca.OP_INPUT: "INPUT", ca.OP_OUTPUT: "OUTPUT"}

_HEAD = """\
#include <math.h>
#if defined(__GLIBC__) && defined(__x86_64__) && (defined(__AVX512F__) || defined(__AVX2__))
#define SINCE(major, minor) __GLIBC_PREREQ(major, minor)
#else
#define SINCE(major, minor) 0
#endif
#ifdef __AVX512F__
#define L 8
#define VECTOR(kind, name) _ZGVeN8##kind##_##name
#else
#define L 4
#define VECTOR(kind, name) _ZGVdN4##kind##_##name
#endif
#ifdef __AVX__
#define LEAVE __builtin_ia32_vzeroupper()
#else
#define LEAVE
#endif
typedef double V __attribute__((vector_size(8 * L)));
typedef long long M __attribute__((vector_size(8 * L)));
#define EACH for (int l = 0; l < L; l++)
static inline V all(double c) { V r; EACH r[l] = c; return r; }
static inline V choose(M m, V a, V b) { return (V)(((M)a & m) | ((M)b & ~m)); }
static inline V truth(M m) { return (V)((M)all(1.0) & m); }
static inline V magnitude(V a) { M m; EACH m[l] = 0x7fffffffffffffffLL; return (V)((M)a & m); }
"""


Entry = Callable[..., None]


def kernel(function: ca.Function) -> Entry | None:
    """The compiled ``function``, which is dense and of scalar instructions; ``None`` where it cannot be compiled.

    It is called with the number of rows, and the :func:`~ocp_envs.support.arrays.pointers` to contiguous arrays of
    arguments and of results, each in the memory of (rows, entries) with the entries of matrices column by column.
    Other Python threads run meanwhile.
    """
    if not vectorisable(function) or function.n_instructions() > MOST_INSTRUCTIONS:
        return None

    def entry(library: Path) -> Entry:
        found = ctypes.CDLL(str(library))[symbol(function)]
        found.argtypes, found.restype = (ctypes.c_longlong, ctypes.c_void_p, ctypes.c_void_p), None
        return cast(Entry, found)

    content = (function.serialize(), written_by(__name__))
    return compiled("rows", content, lambda: source([function]), FLAGS, entry)


def vectorisable(function: ca.Function) -> bool:
    """Whether ``function`` consists of scalar instructions that a kernel can have."""
    if not function.is_a("SXFunction"):
        return False
    return all(function.instruction_id(k) in _NAMES for k in range(function.n_instructions()))


def symbol(function: ca.Function) -> str:
    """The name in C of the kernel of ``function``."""
    return f"rows_{function.name()}"


def declaration(function: ca.Function) -> str:
    """The declaration in C of the kernel of ``function``; null arguments are zero, null results are not wanted."""
    return f"void {symbol(function)}(long long n, const double *const *a, double *const *r)"


def source(functions: Sequence[ca.Function]) -> str:
    """The C of the kernels of ``functions``, which are :func:`vectorisable`."""
    used: set[str] = set()
    frames = [line for function in functions for line in _frame(function, list(_body(function, used)))]
    return "\n".join([_HEAD, *(_library_function(name) for name in sorted(used)), *frames])


def _body(function: ca.Function, used: set[str]) -> Iterator[str]:
    """A line of C for every instruction; ``used`` receives the functions of the mathematical library."""
    for k in range(function.n_instructions()):
        name, arguments = _NAMES[function.instruction_id(k)], function.instruction_input(k)
        results = function.instruction_output(k)
        if name == "INPUT":
            yield f"w{results[0]} = x{arguments[0]}[{arguments[1]}];"
        elif name == "OUTPUT":
            yield f"y{results[0]}[{results[1]}] = w{arguments[0]};"
        elif name == "CONST":
            yield f"w{results[0]} = all({_constant(function.instruction_constant(k))});"
        else:
            operands = [f"w{i}" for i in arguments]
            if name in _EXPRESSIONS:
                expression = _EXPRESSIONS[name].format(*operands)
            else:
                used.add(name.lower())
                expression = f"v_{name.lower()}({', '.join(operands)})"
            yield f"w{results[0]} = {expression};"


def _constant(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    return float(value).hex() if math.isfinite(value) else f"{'-' if value < 0 else ''}INFINITY"


def _library_function(name: str) -> str:
    """The function ``name`` of C's mathematical library on vectors."""
    two = name.upper() in _OF_TWO
    types, names, lanes = ("V, V", "V a, V b", "a[l], b[l]") if two else ("V", "V a", "a[l]")
    each = f"static inline V v_{name}({names}) {{ V r; EACH r[l] = {name}({lanes}); return r; }}"
    if name not in _VECTOR:
        return each
    symbol = f"VECTOR({'vv' if two else 'v'}, {name})"
    return f"#if SINCE({_VECTOR[name]})\nV {symbol}({types});\n#define v_{name} {symbol}\n#else\n{each}\n#endif"


def _frame(function: ca.Function, body: Sequence[str]) -> Iterator[str]:
    """The loop over vectors of rows around ``body``; the last row fills what is left of the last vector."""
    work = sorted({i for k in range(function.n_instructions()) for i in _written(function, k)})
    yield f"{declaration(function)} {{"
    yield "for (long long i = 0; i < n; i += L) {"
    yield "const long long m = n - i < L ? n - i : L;"
    if work:
        yield f"V {', '.join(f'w{i}' for i in work)};"
    for i in range(function.n_in()):
        if size := function.nnz_in(i):
            yield f"V x{i}[{size}];"
            yield f"if (a[{i}]) EACH {{ const double *p = a[{i}] + (i + (l < m ? l : m - 1)) * {size};"
            yield f"for (int k = 0; k < {size}; k++) x{i}[k][l] = p[k]; }}"
            yield f"else for (int k = 0; k < {size}; k++) x{i}[k] = all(0.0);"
    yield from (f"V y{i}[{max(function.nnz_out(i), 1)}];" for i in range(function.n_out()))
    yield from body
    for i in range(function.n_out()):
        size = function.nnz_out(i)
        yield f"if (r[{i}]) for (int l = 0; l < m; l++) for (int k = 0; k < {size}; k++)"
        yield f"r[{i}][(i + l) * {size} + k] = y{i}[k][l];"
    yield "} LEAVE; }"


def _written(function: ca.Function, k: int) -> Sequence[int]:
    """The intermediate values that instruction number ``k`` writes."""
    is_output = function.instruction_id(k) == ca.OP_OUTPUT
    return [] if is_output else cast(Sequence[int], function.instruction_output(k))
