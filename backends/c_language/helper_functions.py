"""Writes the small functions that a generated file defines for itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from backends.c_language.tree import (
    Argument,
    Assign,
    Binary,
    Conditional,
    CType,
    Declare,
    Element,
    Expression,
    Function,
    Name,
    Real,
    Return,
    Statement,
    Unary,
    Unsigned,
)
from compiler.ir.types import Kind


class Calls(Protocol):
    """Spells what helpers call; another helper is defined too then."""

    @property
    def prefix(self) -> str: ...

    def helper(self, name: str, arguments: tuple[Expression, ...]) -> Expression: ...

    def library(self, function: str, arguments: tuple[Expression, ...]) -> Expression: ...

    def truth(self, condition: Expression) -> Expression: ...

    def select(
        self, kind: Kind, condition: Expression, then: Expression, otherwise: Expression
    ) -> Expression: ...


def is_nan(x: Name) -> Expression:
    """Every number is at most +∞; comparing x with itself would draw warnings."""
    return Unary("!", Binary("<=", x, Real(math.inf)))


def one_if(condition: Expression) -> Expression:
    """1 or 0: `&&` and `if` would skip instructions."""
    return Conditional(condition, Unsigned(1), Unsigned(0))


def _truth(calls: Calls) -> Function:
    condition, known = Name("condition"), Name("known")
    body: tuple[Statement, ...] = (
        Declare(CType.BOOL, known.text, condition, constant=True, volatile=True),
        Return(known),
    )
    doc = "The condition; compilers cannot write code for true and for false behind it."
    name, arguments = f"{calls.prefix}_truth", (Argument("bool", condition.text),)
    return Function(
        name=name, result="bool", arguments=arguments, body=body, doc=doc, static=True, inline=True
    )


def _select(calls: Calls) -> Function:
    doc = "One of two values that are both there: no branch, an element of an array instead."
    return _selecting(calls, "select", CType.REAL, f"{calls.prefix}_real", doc)


def _select_truth(calls: Calls) -> Function:
    return _selecting(calls, "select_truth", CType.BOOL, "bool", "The same for truth values.")


def _selecting(calls: Calls, name: str, type: CType, written: str, doc: str) -> Function:
    condition, then, otherwise, both = (
        Name(text) for text in ("condition", "then", "otherwise", "both")
    )
    arguments = (
        Argument("bool", condition.text),
        Argument(written, then.text),
        Argument(written, otherwise.text),
    )
    body: tuple[Statement, ...] = (
        Declare(type, both.text, size=2),
        Assign(Element(both, Unsigned(0)), otherwise),
        Assign(Element(both, Unsigned(1)), then),
        Return(Element(both, one_if(condition))),
    )
    name = f"{calls.prefix}_{name}"
    return Function(
        name=name, result=written, arguments=arguments, body=body, doc=doc, static=True, inline=True
    )


def _outside(calls: Calls) -> Function:
    x, low, high = Name("x"), Name("low"), Name("high")
    above, below = (calls.truth(Binary(*test)) for test in ((">=", x, low), ("<=", x, high)))
    inside = Binary("&", one_if(above), one_if(below))
    doc = "1 if x is not within low .. high, NaN included, else 0."
    real = f"{calls.prefix}_real"
    return Function(
        name=f"{calls.prefix}_outside",
        result="uint32_t",
        arguments=tuple(Argument(real, name.text) for name in (x, low, high)),
        body=(Return(Binary("^", inside, Unsigned(1))),),
        doc=doc,
        static=True,
        inline=True,
    )


def _choice(name: str, first: str, second: str, doc: str) -> Callable[[Calls], Function]:
    """`first` and `second` are the relations of a to b by which a and b are chosen."""

    def make(calls: Calls) -> Function:
        a, b = Name("a"), Name("b")
        # neither holds where one is NaN, and then so is the sum
        otherwise = calls.select("real", calls.truth(Binary(second, a, b)), b, Binary("+", a, b))
        value = calls.select("real", calls.truth(Binary(first, a, b)), a, otherwise)
        return _inline(calls, name, ("a", "b"), value, doc)

    return make


def _clamp(calls: Calls) -> Function:
    raised = calls.helper("maximum", (Name("x"), Name("low")))
    limited = calls.helper("minimum", (raised, Name("high")))
    return _inline(calls, "clamp", ("x", "low", "high"), limited, "x within low .. high.")


def _sign(calls: Calls) -> Function:
    x, zero = Name("x"), Real(0.0)
    level, negative, positive = (calls.truth(Binary(test, x, zero)) for test in (">=", "<", ">"))
    # where nothing holds x is NaN, and the result x itself
    otherwise = calls.select("real", negative, Real(-1.0), calls.select("real", level, zero, x))
    value = calls.select("real", positive, Real(1.0), otherwise)
    return _inline(calls, "sign", ("x",), value, "-1, 0 or 1; NaN of NaN.")


def _square_root(calls: Calls) -> Function:
    x, zero = Name("x"), Real(0.0)
    valid = calls.truth(Binary(">=", x, zero))
    root = calls.library("sqrt", (calls.select("real", valid, x, zero),))
    value = calls.select("real", valid, root, Real(math.nan))
    doc = "The square root; libraries take longer to report that a number has none."
    return _inline(calls, "square_root", ("x",), value, doc)


def _inline(
    calls: Calls, name: str, arguments: tuple[str, ...], value: Expression, doc: str
) -> Function:
    real = f"{calls.prefix}_real"
    return Function(
        name=f"{calls.prefix}_{name}",
        result=real,
        arguments=tuple(Argument(real, argument) for argument in arguments),
        body=(Return(value),),
        doc=doc,
        static=True,
        inline=True,
    )


HELPERS: Mapping[str, Callable[[Calls], Function]] = {
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
