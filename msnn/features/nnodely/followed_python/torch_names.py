"""Lists the supported torch functions, with their translations."""

from __future__ import annotations

import math
from collections.abc import Callable

from msnn.features.nnodely.terms.terms import Minus, Term, call, infix, joined, number, power


def _called(name: str) -> Callable[..., Term]:
    def make(*args: Term) -> Term:
        return call(name, *args)

    return make


def _infix(sign: str) -> Callable[..., Term]:
    def make(left: Term, right: Term) -> Term:
        return infix(sign, left, right)

    return make


def negative(term: Term) -> Term:
    """−x."""
    return joined(Minus(), term)


def _square(term: Term) -> Term:
    return power(term, number(2))


def _reciprocal(term: Term) -> Term:
    return infix("/", number(1), term)


def _rsqrt(term: Term) -> Term:
    return infix("/", number(1), call("sqrt", term))


def _exp2(term: Term) -> Term:
    return call("exp", infix("*", number(math.log(2.0)), term))


def _log_to(base: float) -> Callable[[Term], Term]:
    def make(term: Term) -> Term:
        return infix("/", call("log", term), number(math.log(base)))

    return make


# the language has neither expm1 nor log1p: near 0 they lose digits that torch keeps
def _expm1(term: Term) -> Term:
    return infix("-", call("exp", term), number(1))


def _log1p(term: Term) -> Term:
    return call("log", infix("+", number(1), term))


def _silu(term: Term) -> Term:
    return infix("*", term, call("sigmoid", term))


SAME = {
    name: _called(name)
    for name in [
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "log",
        "sqrt",
        "abs",
        "sign",
        "sigmoid",
        "softplus",
        "relu",
        "elu",
    ]
}
SCALAR: dict[str, Callable[..., Term]] = {
    **SAME,
    "arcsin": _called("asin"),
    "arccos": _called("acos"),
    "arctan": _called("atan"),
    "arctan2": _called("atan2"),
    "absolute": _called("abs"),
    "sgn": _called("sign"),
    "neg": negative,
    "negative": negative,
    "square": _square,
    "reciprocal": _reciprocal,
    "rsqrt": _rsqrt,
    "exp2": _exp2,
    "expm1": _expm1,
    "log1p": _log1p,
    "log2": _log_to(2.0),
    "log10": _log_to(10.0),
    "silu": _silu,
    "add": _infix("+"),
    "sub": _infix("-"),
    "subtract": _infix("-"),
    "mul": _infix("*"),
    "multiply": _infix("*"),
    "div": _infix("/"),
    "divide": _infix("/"),
    "true_divide": _infix("/"),
    "pow": power,
    "minimum": _called("min"),
    "maximum": _called("max"),
    "gt": _infix(">"),
    "lt": _infix("<"),
    "ge": _infix(">="),
    "le": _infix("<="),
}
"""Functions of one sample and element of each argument."""

ARGUMENTS = dict.fromkeys(
    [
        "atan2",
        "arctan2",
        "add",
        "sub",
        "subtract",
        "mul",
        "multiply",
        "div",
        "divide",
        "true_divide",
        "pow",
        "minimum",
        "maximum",
        "gt",
        "lt",
        "ge",
        "le",
    ],
    2,
)
"""Number of arguments; 1 if not listed."""

NUMBERS = {"pi": math.pi, "e": math.e, "inf": math.inf}
"""Members of torch that are numbers."""
