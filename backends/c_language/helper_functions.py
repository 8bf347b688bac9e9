"""Writes the helper functions that a generated file defines."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from backends.c_language import tree as c
from compiler.ir.types import Kind


class Calls(Protocol):
    """Creates the calls inside helpers; a called helper is defined as well."""

    @property
    def prefix(self) -> str: ...

    def helper(self, name: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def library(self, function: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def truth(self, condition: c.Expression) -> c.Expression: ...

    def select(
        self, kind: Kind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression: ...


def is_nan(x: c.Name) -> c.Expression:
    """True for NaN only, since every number is ≤ +∞; `x != x` would cause compiler warnings."""
    return c.Unary("!", c.Binary("<=", x, c.Real(math.inf)))


def one_if(condition: c.Expression) -> c.Expression:
    """1 or 0 without `&&` and `if`, which skip instructions."""
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
    """Selects a or b by the relations `first` and `second` of a to b."""

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
