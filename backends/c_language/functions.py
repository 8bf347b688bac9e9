"""Selects the functions that generated code calls: msnn kernels, a C library, or helpers."""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.helper_functions import HELPERS
from backends.c_language.literals import Dtype, suffix
from backends.c_language.math_library import MathLibrary
from backends.c_language.tree import Call, Conditional, Expression, Function
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Kind

_IN_LIBM = frozenset(
    {"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"}
    | {"exp", "log", "pow"}
)
_EXACT = {"sqrt": "sqrt", "abs": "fabs"}
"""Functions that IEEE 754 defines exactly: every C library gives the same bits."""


@dataclass(frozen=True, slots=True)
class FunctionNames:
    """The names of functions in this program."""

    prefix: str
    dtype: Dtype
    math: MathLibrary
    constant_time: bool = False

    def kernel(self, function: str) -> str | None:
        """The msnn kernel of a scalar function; None if a library function is used."""
        # functions that libm lacks, such as softplus, use their kernel even with `math: libm`
        row = SCALAR_FUNCTIONS[function]
        if row.kernel is None or (self.math == "libm" and function in _IN_LIBM):
            return None
        return row.kernel

    def library(self, function: str) -> str:
        """The name in the C library, for the program's type."""
        return _EXACT.get(function, function) + suffix(self.dtype)


class FunctionTable:
    """Creates calls and records the called functions."""

    def __init__(self, names: FunctionNames) -> None:
        self._names = names
        self.kernels: set[str] = set()
        self.helpers: set[str] = set()

    @property
    def prefix(self) -> str:
        """Prefix of the names of its functions."""
        return self._names.prefix

    @property
    def constant_time(self) -> bool:
        """True if the same instructions are executed for all values."""
        return self._names.constant_time

    @property
    def dtype(self) -> Dtype:
        """Number format of the program."""
        return self._names.dtype

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        """A call of a scalar function of the language."""
        # neither an IEEE operation nor a kernel: exact by comparisons
        if function == "sign":
            return self.helper("sign", arguments)
        if function == "sqrt" and self.constant_time:
            return self.helper("square_root", arguments)
        kernel = self._names.kernel(function)
        if kernel is None:
            return self.library(function, arguments)
        self.kernels.add(kernel)
        return Call(f"{self._names.prefix}_{kernel}", arguments)

    def library(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        """A call of a C library function."""
        return Call(self._names.library(function), arguments)

    def truth(self, condition: Expression) -> Expression:
        """The result of a comparison."""
        return self.helper("truth", (condition,)) if self.constant_time else condition

    def select(
        self, kind: Kind, condition: Expression, then: Expression, otherwise: Expression
    ) -> Expression:
        """One of two values; both are computed."""
        if not self.constant_time:
            return Conditional(condition, then, otherwise)
        name = "select" if kind == "real" else "select_truth"
        return self.helper(name, (condition, then, otherwise))

    def helper(self, name: str, arguments: tuple[Expression, ...]) -> Expression:
        """A call of a helper function, which the generated file defines."""
        self.helpers.add(name)
        return Call(f"{self._names.prefix}_{name}", arguments)

    def definitions(self) -> tuple[Function, ...]:
        """The called helpers, callees first."""
        made: list[Function] = []
        # backwards: a helper may call others, which come before it in the table
        for name, make in reversed(tuple(HELPERS.items())):
            if name in self.helpers:
                made.append(make(self))
        return tuple(reversed(made))
