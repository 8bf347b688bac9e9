"""Evaluates parts of a function that are known without data: numbers, lists, `range` loops."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from msnn.features.nnodely.arrays import NotTranslatedError
from msnn.features.nnodely.followed_python.torch_calls import (
    added,
    elementwise,
    is_tensor,
    method,
    shape_of,
)
from msnn.features.nnodely.terms import Term, larger, minus, power, quotient, times

LARGEST = 10**15
"""Largest integers; beyond them, repeated products would exhaust the memory."""
LONGEST = 10_000
"""Maximum elements of a list or iterations of a loop."""
COMPARED: Mapping[type[ast.cmpop], str] = {
    ast.Gt: "gt",
    ast.Lt: "lt",
    ast.GtE: "ge",
    ast.LtE: "le",
    ast.Eq: "eq",
    ast.NotEq: "ne",
}
"""Comparisons of tensors, by torch name."""
# `&` and `|` join truths, which are 1 and 0 in terms
OPERATORS: Mapping[type[ast.operator], Callable[[Term, Term], Term]] = {
    ast.Add: added,
    ast.Sub: minus,
    ast.Mult: times,
    ast.Div: quotient,
    ast.Pow: power,
    ast.BitAnd: times,
    ast.BitOr: larger,
}
"""Operators of tensors, by the operation on two elements."""
BUILTINS = frozenset(("range", "len", "float", "int", "abs", "sum", "min", "max"))


def is_number(value: Any) -> bool:
    """True if a value is a known number."""
    return isinstance(value, bool | int | float)


def folded(op: ast.operator, left: Any, right: Any) -> float:
    """The result of an arithmetic operator on two known numbers. Raises NotTranslatedError for
    other operators, complex results and integers beyond LARGEST, and ZeroDivisionError.
    """
    match op:
        case ast.Add():
            found = left + right
        case ast.Sub():
            found = left - right
        case ast.Mult():
            found = left * right
        case ast.Div():
            found = left / right
        case ast.FloorDiv():
            found = left // right
        case ast.Mod():
            found = left % right
        case ast.Pow():
            found = _power(left, right)
        case _:
            raise NotTranslatedError(f"the operator `{kind_of(op)}`")
    # checked after each step: the next one then starts from few digits
    if isinstance(found, int) and abs(found) > LARGEST:
        raise NotTranslatedError("a whole number is too large")
    return found


def has_length(value: Any, count: int) -> bool:
    """True if a value is a list of `count` items."""
    return isinstance(value, list) and len(cast("list[Any]", value)) == count


def lengthened(left: list[Any], right: list[Any]) -> list[Any]:
    """Concatenates two lists. Raises NotTranslatedError beyond LONGEST items."""
    if len(left) + len(right) > LONGEST:
        raise NotTranslatedError("a list is too long")
    return [*left, *right]


def compared(op: ast.cmpop, left: Any, right: Any) -> bool:
    """The result of a comparison operator on two known values. Raises NotTranslatedError for other
    operators, such as `in`.
    """
    match op:
        case ast.Eq():
            return bool(left == right)
        case ast.NotEq():
            return bool(left != right)
        case ast.Lt():
            return bool(left < right)
        case ast.LtE():
            return bool(left <= right)
        case ast.Gt():
            return bool(left > right)
        case ast.GtE():
            return bool(left >= right)
        case _:
            raise NotTranslatedError(f"the comparison `{kind_of(op)}`")


def shares(value: Any, held: Any) -> bool:
    """True if an in-place change of `value` would also change `held`, a value or a list
    of values.
    """
    # a tensor in a list is reached by whoever has the list
    if isinstance(held, list):
        return held is value or any(shares(value, one) for one in cast("list[Any]", held))
    if isinstance(value, np.ndarray) and isinstance(held, np.ndarray):
        return np.may_share_memory(cast("Any", value), cast("Any", held))
    return is_tensor(value) and value is held


def called(name: str, arguments: Sequence[Any]) -> Any:
    """The result of a builtin function of Python, such as `len` or `range`, on known values. `abs`,
    `len` and `sum` also take tensors. Raises NotTranslatedError for other calls and long ranges.
    """
    first = arguments[0] if arguments else None
    all_numbers = bool(arguments) and all(is_number(one) for one in arguments)
    if name == "range" and all_numbers and not any(isinstance(a, float) for a in arguments):
        found = range(*cast("Sequence[int]", arguments))
        if len(found) > LONGEST:
            raise NotTranslatedError("a loop is too long")
        return list(found)
    if name == "len" and isinstance(first, list):
        return len(cast("list[Any]", first))
    if name == "len" and is_tensor(first):
        return shape_of(first)[0]
    if name == "abs" and is_tensor(first):
        return method("abs", [first], {})
    if name == "sum" and isinstance(first, list) and first:
        # a second argument is what the sum begins with
        total, *items = [*arguments[1:], *cast("list[Any]", first)]
        for item in items:
            total = (
                folded(ast.Add(), total, item)
                if is_number(total) and is_number(item)
                else (elementwise(added, total, item))
            )
        return total
    if all_numbers and name in {"float", "int", "abs", "min", "max"}:
        made = {"float": float, "int": int, "abs": abs, "min": min, "max": max}[name]
        return cast("Any", made)(*arguments)
    raise NotTranslatedError(f"the call of `{name}`")


def kind_of(node: ast.AST) -> str:
    """The name of a node of Python's syntax tree in messages."""
    return type(node).__name__.lower()


def _power(left: Any, right: Any) -> float:
    # in double precision, as 9 ** 9 ** 9 of whole numbers would not end
    found = float(left) ** float(right)
    if isinstance(found, complex):
        raise NotTranslatedError("a complex number")
    whole = isinstance(left, int) and isinstance(right, int) and right >= 0
    return int(found) if whole and abs(found) <= LARGEST else found
