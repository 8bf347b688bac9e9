"""Recognises time indices of other tools: `k+1`, `1+t`."""

import ast

_INDICES = {"k", "n", "i", "t"}
"""Names of the present sample in textbooks, including `t`, the name here."""


def time_elsewhere(node: ast.expr) -> str | None:
    """`t+1` for `k+1` and `1+t`, `t` for `k`; None where nothing is clear.

    A number alone stays unclear: `x[-1]` is the last of a list in Python and the sample before in
    other tools.
    """
    match node:
        case ast.Name(id=name) if name in _INDICES:
            return "t"
        case ast.BinOp(left=ast.Name(id=name), op=op, right=ast.Constant(value=int(count))) if (
            name in _INDICES
        ):
            return _offset(op, count)
        case ast.BinOp(
            # not `1-k`: time that runs backwards is no sample of a log
            left=ast.Constant(value=int(count)),
            op=ast.Add() as op,
            right=ast.Name(id=name),
        ) if name in _INDICES:
            return _offset(op, count)
        case _:
            return None


def index_of(node: ast.expr) -> str | None:
    """The number that stands where a time is wanted, as an index of a list; None for others."""
    match node:
        # `True` is an integer to Python
        case ast.Constant(value=int(index)) if not isinstance(index, bool):
            return str(index)
        case _:
            return None


def _offset(op: ast.operator, count: int) -> str | None:
    match op:
        case ast.Add():
            return f"t+{count}"
        case ast.Sub():
            return f"t-{count}"
        case _:
            return None
