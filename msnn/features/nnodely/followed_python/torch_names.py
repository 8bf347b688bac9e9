"""Lists the supported torch functions, modules and numbers of an interpreted function."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass

from msnn.features.nnodely.arrays import NotTranslatedError
from msnn.features.nnodely.terms import Minus, Term, call, infix, joined, number, power


def _called(name: str) -> Callable[..., Term]:
    def make(*args: Term) -> Term:
        return call(name, *args)

    return make


def _infix(sign: str) -> Callable[..., Term]:
    def make(left: Term, right: Term) -> Term:
        return infix(sign, left, right)

    return make


def negative(term: Term) -> Term:
    """The term −x."""
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


MODULES = frozenset({"torch", "math"})
"""Modules with translated functions; functions of a file may use them without import."""

LOWERED = {"true": True, "false": False, "null": None}
"""Words that nnodely converts to lower case when it saves source code."""


@dataclass(frozen=True, slots=True)
class Module:
    """A module or a member of one, by its path: `torch`, `torch.nn.functional`, `torch.abs`."""

    path: str

    def member(self, name: str) -> Module | float:
        """The number of torch or math with this name, such as `pi`, else the path of the member;
        whether it is supported is checked at its call.
        """
        # any other member is a path, judged where it is called: nothing is looked up in a real
        # module
        is_number = self.path in MODULES and name in NUMBERS
        return NUMBERS[name] if is_number else Module(f"{self.path}.{name}")


def imported(statement: ast.Import | ast.ImportFrom) -> dict[str, Module | float]:
    """The names that an import statement binds, each with its module or number. Raises
    NotTranslatedError for modules other than torch and math, and for `*`.
    """
    if isinstance(statement, ast.ImportFrom):
        module = _known("." * statement.level + (statement.module or ""))
        for one in statement.names:
            if one.name == "*":
                raise NotTranslatedError(f"an import of `{module.path}.*`")
        return {one.asname or one.name: module.member(one.name) for one in statement.names}
    found: dict[str, Module | float] = {}
    for one in statement.names:
        module = _known(one.name)
        first = one.name.partition(".")[0]
        # as Python: `import torch.nn` gives a name to `torch`, `import torch.nn as nn` to
        # `torch.nn`
        found[one.asname or first] = module if one.asname else Module(first)
    return found


def _known(path: str) -> Module:
    if path.partition(".")[0] in MODULES:
        return Module(path)
    raise NotTranslatedError(f"an import of `{path}`")
