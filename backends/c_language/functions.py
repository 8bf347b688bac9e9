"""Writes the operations and calls of generated C: own kernels, a C library, or helper functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, assert_never

from backends.c_language import tree as c
from backends.c_language.literals import Dtype, suffix
from backends.c_language.math_library import MathLibrary
from backends.c_language.tree import Call, Conditional, Expression, Function
from compiler.ir import ops
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
    """The rules for names of C functions in one program: prefix, real type, source of math
    functions (`own` kernels or `libm`), and whether code takes constant time.
    """

    prefix: str
    dtype: Dtype
    math: MathLibrary
    constant_time: bool = False

    def kernel(self, function: str) -> str | None:
        """The name of the math kernel for a scalar function of the language, without prefix; None
        if a C library function is called. Raises KeyError for an unknown function.
        """
        # functions that libm lacks, such as softplus, use their kernel even with `math: libm`
        row = SCALAR_FUNCTIONS[function]
        if row.kernel is None or (self.math == "libm" and function in _IN_LIBM):
            return None
        return row.kernel

    def library(self, function: str) -> str:
        """The name of a function in the C library for the program's type: `sinf`, `fabs`."""
        return _EXACT.get(function, function) + suffix(self.dtype)


class FunctionTable:
    """Writes calls of functions, and records in `kernels` and `helpers` the names of those that the
    generated files must define.
    """

    def __init__(self, names: FunctionNames) -> None:
        self._names = names
        self.kernels: set[str] = set()
        self.helpers: set[str] = set()

    @property
    def prefix(self) -> str:
        """The prefix of all C names of the program."""
        return self._names.prefix

    @property
    def constant_time(self) -> bool:
        """True if the code must execute the same instructions for all values."""
        return self._names.constant_time

    @property
    def dtype(self) -> Dtype:
        """The number format of the program's reals, float32 or float64."""
        return self._names.dtype

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        """A C call of a scalar function of the language, such as `tanh`: a math kernel, a C library
        function or a helper.
        """
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
        """A call of a C library function; `function` is its name without the suffix of the type."""
        return Call(self._names.library(function), arguments)

    def truth(self, condition: Expression) -> Expression:
        """The condition as it is. In constant time it is passed through a function that stops
        compilers from branching on it.
        """
        return self.helper("truth", (condition,)) if self.constant_time else condition

    def select(
        self, kind: Kind, condition: Expression, then: Expression, otherwise: Expression
    ) -> Expression:
        """A C expression with one of two values of this kind (real or bool), chosen by a condition.
        In constant time both are computed, without a branch.
        """
        if not self.constant_time:
            return Conditional(condition, then, otherwise)
        name = "select" if kind == "real" else "select_truth"
        return self.helper(name, (condition, then, otherwise))

    def helper(self, name: str, arguments: tuple[Expression, ...]) -> Expression:
        """A call of a helper function (a name in HELPERS), which the generated file then
        defines.
        """
        self.helpers.add(name)
        return Call(f"{self._names.prefix}_{name}", arguments)

    def definitions(self) -> tuple[Function, ...]:
        """Definitions of the helpers that were called; a helper comes after those that it calls."""
        made: list[Function] = []
        # backwards: a helper may call others, which come before it in the table
        for name, make in reversed(tuple(HELPERS.items())):
            if name in self.helpers:
                made.append(make(self))
        return tuple(reversed(made))


class Calls(Protocol):
    """The part of `FunctionTable` that definitions of helpers use: it writes the calls in them, and
    records the called helpers.
    """

    @property
    def prefix(self) -> str: ...

    def helper(self, name: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def library(self, function: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def truth(self, condition: c.Expression) -> c.Expression: ...

    def select(
        self, kind: Kind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression: ...


def is_nan(x: c.Name) -> c.Expression:
    """A C condition that is true for NaN only, since every number is ≤ +∞; `x != x` would cause
    compiler warnings.
    """
    return c.Unary("!", c.Binary("<=", x, c.Real(math.inf)))


def one_if(condition: c.Expression) -> c.Expression:
    """The C expression `condition ? 1U : 0U`, to combine conditions by arithmetic; `&&` and `if`
    would skip instructions.
    """
    return c.Conditional(condition, c.Unsigned(1), c.Unsigned(0))


def _truth(calls: Calls) -> c.Function:
    condition, known = c.Name("condition"), c.Name("known")
    body: tuple[c.Statement, ...] = (
        # volatile: otherwise a compiler could branch on the comparison
        c.Declare(c.CType.BOOL, known.text, condition, constant=True, volatile=True),
        c.Return(known),
    )
    doc = "The condition; compilers cannot write code for true and for false behind it."
    name, arguments = f"{calls.prefix}_truth", (c.Argument("bool", condition.text),)
    return c.Function(
        name=name, result="bool", arguments=arguments, body=body, doc=doc, static=True, inline=True
    )


def _select(calls: Calls) -> c.Function:
    doc = "One of two values that are both there: no branch, an element of an array instead."
    return _selecting(calls, "select", c.CType.REAL, f"{calls.prefix}_real", doc)


def _select_truth(calls: Calls) -> c.Function:
    return _selecting(calls, "select_truth", c.CType.BOOL, "bool", "The same for truth values.")


def _selecting(calls: Calls, name: str, type: c.CType, written: str, doc: str) -> c.Function:
    condition, then, otherwise, both = (
        c.Name(text) for text in ("condition", "then", "otherwise", "both")
    )
    arguments = (
        c.Argument("bool", condition.text),
        c.Argument(written, then.text),
        c.Argument(written, otherwise.text),
    )
    body: tuple[c.Statement, ...] = (
        # an array element selected by the condition: the load takes the same time for both
        c.Declare(type, both.text, size=2),
        c.Assign(c.Element(both, c.Unsigned(0)), otherwise),
        c.Assign(c.Element(both, c.Unsigned(1)), then),
        c.Return(c.Element(both, one_if(condition))),
    )
    name = f"{calls.prefix}_{name}"
    return c.Function(
        name=name, result=written, arguments=arguments, body=body, doc=doc, static=True, inline=True
    )


def _outside(calls: Calls) -> c.Function:
    x, low, high = c.Name("x"), c.Name("low"), c.Name("high")
    above, below = (calls.truth(c.Binary(*test)) for test in ((">=", x, low), ("<=", x, high)))
    # bitwise: `&&` would skip the second comparison
    inside = c.Binary("&", one_if(above), one_if(below))
    doc = "1 if x is not within low .. high, NaN included, else 0."
    real = f"{calls.prefix}_real"
    return c.Function(
        name=f"{calls.prefix}_outside",
        result="uint32_t",
        arguments=tuple(c.Argument(real, name.text) for name in (x, low, high)),
        body=(c.Return(c.Binary("^", inside, c.Unsigned(1))),),
        doc=doc,
        static=True,
        inline=True,
    )


def _choice(name: str, first: str, second: str, doc: str) -> Callable[[Calls], c.Function]:
    """Makes the helper `name` of two reals: a if `a first b`, b if `a second b`, otherwise NaN.
    `first` and `second` are comparison operators; `doc` is the comment in C.
    """

    def make(calls: Calls) -> c.Function:
        a, b = c.Name("a"), c.Name("b")
        # neither holds if one is NaN; the sum is then NaN
        otherwise = calls.select(
            "real", calls.truth(c.Binary(second, a, b)), b, c.Binary("+", a, b)
        )
        value = calls.select("real", calls.truth(c.Binary(first, a, b)), a, otherwise)
        return _inline(calls, name, ("a", "b"), value, doc)

    return make


def _clamp(calls: Calls) -> c.Function:
    raised = calls.helper("maximum", (c.Name("x"), c.Name("low")))
    # low first, then high: crossed limits give the upper one, as in the interpreter
    limited = calls.helper("minimum", (raised, c.Name("high")))
    return _inline(calls, "clamp", ("x", "low", "high"), limited, "x within low .. high.")


def _sign(calls: Calls) -> c.Function:
    x, zero = c.Name("x"), c.Real(0.0)
    level, negative, positive = (calls.truth(c.Binary(test, x, zero)) for test in (">=", "<", ">"))
    # if no relation holds, x is NaN, and so is the result
    otherwise = calls.select("real", negative, c.Real(-1.0), calls.select("real", level, zero, x))
    value = calls.select("real", positive, c.Real(1.0), otherwise)
    return _inline(calls, "sign", ("x",), value, "-1, 0 or 1; NaN of NaN.")


def _square_root(calls: Calls) -> c.Function:
    x, zero = c.Name("x"), c.Real(0.0)
    valid = calls.truth(c.Binary(">=", x, zero))
    # the root of 0 if x is negative: error handling of the library would take time
    root = calls.library("sqrt", (calls.select("real", valid, x, zero),))
    value = calls.select("real", valid, root, c.Real(math.nan))
    doc = "The square root; libraries take longer to report that a number has none."
    return _inline(calls, "square_root", ("x",), value, doc)


def _inline(
    calls: Calls, name: str, arguments: tuple[str, ...], value: c.Expression, doc: str
) -> c.Function:
    real = f"{calls.prefix}_real"
    return c.Function(
        name=f"{calls.prefix}_{name}",
        result=real,
        arguments=tuple(c.Argument(real, argument) for argument in arguments),
        body=(c.Return(value),),
        doc=doc,
        static=True,
        inline=True,
    )


HELPERS: Mapping[str, Callable[[Calls], c.Function]] = {
    "truth": _truth,
    "select": _select,
    "select_truth": _select_truth,
    "outside": _outside,
    "minimum": _choice(
        "minimum", "<=", ">", "The smaller one, the first of equal ones; NaN if one is."
    ),
    "maximum": _choice(
        "maximum", ">=", "<", "The larger one, the first of equal ones; NaN if one is."
    ),
    "clamp": _clamp,
    "sign": _sign,
    "square_root": _square_root,
}
"""By name; each helper calls only earlier ones."""


def scalar_operation(
    op: ops.Computed,
    operands: tuple[c.Expression, ...],
    functions: FunctionTable,
    kind: Kind = "real",
) -> c.Expression:
    """The C expression of one element of the result of the operation `op`, from one element of each
    operand. `kind` (real or bool) is the type of the result of a selection.
    """
    match op:
        case ops.Add():
            return c.Binary("+", *operands)
        case ops.Subtract():
            return c.Binary("-", *operands)
        case ops.Multiply():
            return c.Binary("*", *operands)
        case ops.Divide():
            return c.Binary("/", *operands)
        case ops.Negate():
            return c.Unary("-", *operands)
        # not `fmin`, which ignores a NaN operand
        case ops.Minimum():
            return functions.helper("minimum", operands)
        case ops.Maximum():
            return functions.helper("maximum", operands)
        case ops.Clamp():
            return functions.helper("clamp", operands)
        case ops.Compare(relation):
            # in constant time `truth` prevents the compiler from branching on the comparison
            return functions.truth(c.Binary(relation.value, *operands))
        case ops.Select():
            return functions.select(kind, *operands)
        case ops.Apply(function):
            return functions.apply(function, operands)
        case _:
            assert_never(op)


def expression_size(expression: c.Expression) -> int:
    """The number of operations and calls in an expression; variables, literals and array elements
    count 0.
    """
    match expression:
        case (
            c.Name() | c.Real() | c.Integer() | c.Unsigned() | c.Truth() | c.Member() | c.Element()
        ):
            # loads do not count: the limit concerns line length and nesting
            return 0
        case c.Unary(_, operand) | c.Convert(_, operand):
            return 1 + expression_size(operand)
        case c.Binary(_, left, right):
            return 1 + expression_size(left) + expression_size(right)
        case c.Conditional(condition, then, otherwise):
            return 1 + sum(map(expression_size, (condition, then, otherwise)))
        case c.Call(_, arguments):
            return 1 + sum(map(expression_size, arguments))
        case _:
            assert_never(expression)
