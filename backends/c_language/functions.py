"""Chooses what generated code calls: the project's kernels, a C library, functions of its own."""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.helper_functions import HELPERS
from backends.c_language.literals import Dtype, suffix
from backends.c_language.math_library import MathLibrary
from backends.c_language.tree import Call, Conditional, Expression, Function
from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from compiler.ir.types import Kind

_IN_LIBM = frozenset(
    {"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"}
    | {"exp", "log", "pow"}
)
_EXACT = {"sqrt": "sqrt", "abs": "fabs"}
"""Functions that IEEE 754 defines to the bit: every C library has the same ones."""


@dataclass(frozen=True, slots=True)
class FunctionNames:
    """The names of functions as this program spells them."""

    prefix: str
    dtype: Dtype
    math: MathLibrary
    constant_time: bool = False

    def kernel(self, function: str) -> str | None:
        """The project's kernel that computes a scalar function, None where a library does."""
        # functions that libm lacks, such as softplus, have their kernel even with `math: libm`
        row = SCALAR_FUNCTIONS[function]
        if row.kernel is None or (self.math == "libm" and function in _IN_LIBM):
            return None
        return row.kernel

    def library(self, function: str) -> str:
        """The name in the C library, of the program's type."""
        return _EXACT.get(function, function) + suffix(self.dtype)


class FunctionTable:
    """Spells calls and remembers what was called."""

    def __init__(self, names: FunctionNames) -> None:
        self._names = names
        self.kernels: set[str] = set()
        self.helpers: set[str] = set()

    @property
    def prefix(self) -> str:
        """The prefix of the names of its functions."""
        return self._names.prefix

    @property
    def constant_time(self) -> bool:
        """Whether the same instructions are taken for all numbers."""
        return self._names.constant_time

    @property
    def dtype(self) -> Dtype:
        """The program's number type."""
        return self._names.dtype

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        """A scalar function of the language."""
        # no IEEE operation and no kernel: comparisons give it exactly
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
        """A function of the C library."""
        return Call(self._names.library(function), arguments)

    def truth(self, condition: Expression) -> Expression:
        """The result of a comparison."""
        return self.helper("truth", (condition,)) if self.constant_time else condition

    def select(
        self, kind: Kind, condition: Expression, then: Expression, otherwise: Expression
    ) -> Expression:
        """One of two values that are both computed."""
        if not self.constant_time:
            return Conditional(condition, then, otherwise)
        name = "select" if kind == "real" else "select_truth"
        return self.helper(name, (condition, then, otherwise))

    def helper(self, name: str, arguments: tuple[Expression, ...]) -> Expression:
        """A function that the generated file defines for itself."""
        self.helpers.add(name)
        return Call(f"{self._names.prefix}_{name}", arguments)

    def definitions(self) -> tuple[Function, ...]:
        """The helpers that were called, in the order in which they may call each other."""
        made: list[Function] = []
        # from the last on: making one may add what it calls, which stands before it in the table
        for name, make in reversed(tuple(HELPERS.items())):
            if name in self.helpers:
                made.append(make(self))
        return tuple(reversed(made))
