"""What generated code calls: the project's kernels, a C library, and small functions of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from backends.c.c_language import (
    Argument,
    Binary,
    Call,
    Conditional,
    Expression,
    Function,
    Name,
    Real,
    Return,
    Unary,
)
from backends.c.c_literals import Dtype
from compiler.scalar_functions import SCALAR_FUNCTIONS

MathLibrary = Literal["own", "libm"]

_IN_LIBM = frozenset(
    {"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"}
    | {"exp", "log", "pow"}
)
_EXACT = {"sqrt": "sqrt", "abs": "fabs"}
"""Functions that IEEE 754 defines to the bit: every C library has the same ones."""


@dataclass(frozen=True, slots=True)
class FunctionNames:
    """How this program spells the functions it calls."""

    prefix: str
    dtype: Dtype
    math: MathLibrary

    def kernel(self, function: str) -> str | None:
        """The project's kernel that computes a scalar function, None where a library does."""
        row = SCALAR_FUNCTIONS[function]
        if row.kernel is None or (self.math == "libm" and function in _IN_LIBM):
            return None
        return row.kernel

    def library(self, function: str) -> str:
        """The name in the C library, of the program's type."""
        return _EXACT.get(function, function) + ("f" if self.dtype == "float32" else "")


class FunctionTable:
    """Spells calls and remembers what was called."""

    def __init__(self, names: FunctionNames) -> None:
        self._names = names
        self.kernels: set[str] = set()
        self.helpers: set[str] = set()

    @property
    def dtype(self) -> Dtype:
        """The program's number type."""
        return self._names.dtype

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        """A scalar function of the language."""
        if function == "sign":
            return self.helper("sign", arguments)
        kernel = self._names.kernel(function)
        if kernel is None:
            return Call(self._names.library(function), arguments)
        self.kernels.add(kernel)
        return Call(f"{self._names.prefix}_{kernel}", arguments)

    def helper(self, name: str, arguments: tuple[Expression, ...]) -> Expression:
        """A function that the generated file defines for itself."""
        self.helpers.add(name)
        return Call(f"{self._names.prefix}_{name}", arguments)

    def definitions(self) -> tuple[Function, ...]:
        """The helpers that were called, in the order in which they may call each other."""
        prefix = self._names.prefix
        wanted = set(self.helpers)
        if "clamp" in wanted:
            wanted |= {"minimum", "maximum"}
        return tuple(make(prefix) for name, make in _HELPERS.items() if name in wanted)


def is_nan(x: Name) -> Expression:
    """Every number is at most +∞; comparing x with itself would draw warnings."""
    return Unary("!", Binary("<=", x, Real(math.inf)))


def _choice(name: str, first: str, second: str, doc: str) -> Callable[[str], Function]:
    """`first` and `second` are the relations of a to b by which a and b are chosen."""

    def make(prefix: str) -> Function:
        a, b = Name("a"), Name("b")
        # neither holds where one is NaN, and then so is the sum
        otherwise = Conditional(Binary(second, a, b), b, Binary("+", a, b))
        value = Conditional(Binary(first, a, b), a, otherwise)
        return _inline(prefix, name, ("a", "b"), value, doc)

    return make


def _clamp(prefix: str) -> Function:
    raised = Call(f"{prefix}_maximum", (Name("x"), Name("low")))
    limited = Call(f"{prefix}_minimum", (raised, Name("high")))
    return _inline(prefix, "clamp", ("x", "low", "high"), limited, "x within low .. high.")


def _sign(prefix: str) -> Function:
    x, zero = Name("x"), Real(0.0)
    rest = Conditional(Binary(">=", x, zero), zero, x)
    otherwise = Conditional(Binary("<", x, zero), Real(-1.0), rest)
    value = Conditional(Binary(">", x, zero), Real(1.0), otherwise)
    return _inline(prefix, "sign", ("x",), value, "-1, 0 or 1; NaN of NaN.")


def _inline(
    prefix: str, name: str, arguments: tuple[str, ...], value: Expression, doc: str
) -> Function:
    real = f"{prefix}_real"
    return Function(
        f"{prefix}_{name}",
        real,
        tuple(Argument(real, argument) for argument in arguments),
        (Return(value),),
        doc,
        static=True,
        inline=True,
    )


_HELPERS: dict[str, Callable[[str], Function]] = {
    "minimum": _choice(
        "minimum", "<=", ">", "The smaller one, the first of equal ones; NaN if one is."
    ),
    "maximum": _choice(
        "maximum", ">=", "<", "The larger one, the first of equal ones; NaN if one is."
    ),
    "clamp": _clamp,
    "sign": _sign,
}
