"""Writes the small functions that a generated file defines for itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from backends.c_language import tree as c
from compiler.ir.types import Kind


class Calls(Protocol):
    """Spells what helpers call; another helper is defined too then."""

    @property
    def prefix(self) -> str: ...

    def helper(self, name: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def library(self, function: str, arguments: tuple[c.Expression, ...]) -> c.Expression: ...

    def truth(self, condition: c.Expression) -> c.Expression: ...

    def select(
        self, kind: Kind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression: ...


def is_nan(x: c.Name) -> c.Expression:
    """Every number is at most +∞; comparing x with itself would draw warnings."""
    return c.Unary("!", c.Binary("<=", x, c.Real(math.inf)))


def one_if(condition: c.Expression) -> c.Expression:
    """1 or 0: `&&` and `if` would skip instructions."""
    return c.Conditional(condition, c.Unsigned(1), c.Unsigned(0))


def _truth(calls: Calls) -> c.Function:
    condition, known = c.Name("condition"), c.Name("known")
    body: tuple[c.Statement, ...] = (
        # read back from memory: a compiler that knew where the value is from would branch on the
        # comparison
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
        # in memory at two places that differ by the condition: a load, whose time is the same for
        # both
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
    # 1 and 1 by bits: `&&` would skip the second comparison
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
    """`first` and `second` are the relations of a to b by which a and b are chosen."""

    def make(calls: Calls) -> c.Function:
        a, b = c.Name("a"), c.Name("b")
        # neither holds where one is NaN, and then so is the sum
        otherwise = calls.select(
            "real", calls.truth(c.Binary(second, a, b)), b, c.Binary("+", a, b)
        )
        value = calls.select("real", calls.truth(c.Binary(first, a, b)), a, otherwise)
        return _inline(calls, name, ("a", "b"), value, doc)

    return make


def _clamp(calls: Calls) -> c.Function:
    raised = calls.helper("maximum", (c.Name("x"), c.Name("low")))
    # low first, then high: the upper limit wins where a range is empty, as in the interpreter
    limited = calls.helper("minimum", (raised, c.Name("high")))
    return _inline(calls, "clamp", ("x", "low", "high"), limited, "x within low .. high.")


def _sign(calls: Calls) -> c.Function:
    x, zero = c.Name("x"), c.Real(0.0)
    level, negative, positive = (calls.truth(c.Binary(test, x, zero)) for test in (">=", "<", ">"))
    # where nothing holds x is NaN, and the result x itself
    otherwise = calls.select("real", negative, c.Real(-1.0), calls.select("real", level, zero, x))
    value = calls.select("real", positive, c.Real(1.0), otherwise)
    return _inline(calls, "sign", ("x",), value, "-1, 0 or 1; NaN of NaN.")


def _square_root(calls: Calls) -> c.Function:
    x, zero = c.Name("x"), c.Real(0.0)
    valid = calls.truth(c.Binary(">=", x, zero))
    # of 0 where x has no root: what the library does about errors would take its time
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
"""By name, in an order in which each calls earlier ones only."""
