"""Writes the C expression of each elementwise operation from those of its operands."""

from __future__ import annotations

from typing import assert_never

from backends.c_language.functions import FunctionTable
from backends.c_language.tree import (
    Binary,
    Call,
    Conditional,
    Convert,
    Element,
    Expression,
    Integer,
    Member,
    Name,
    Real,
    Truth,
    Unary,
    Unsigned,
)
from compiler.ir import ops
from compiler.ir.types import Kind


def scalar_operation(
    op: ops.Computed,
    operands: tuple[Expression, ...],
    functions: FunctionTable,
    kind: Kind = "real",
) -> Expression:
    """One element of the operation's value, which is of that kind."""
    match op:
        case ops.Add():
            return Binary("+", *operands)
        case ops.Subtract():
            return Binary("-", *operands)
        case ops.Multiply():
            return Binary("*", *operands)
        case ops.Divide():
            return Binary("/", *operands)
        case ops.Negate():
            return Unary("-", *operands)
        case ops.Minimum():
            return functions.helper("minimum", operands)
        case ops.Maximum():
            return functions.helper("maximum", operands)
        case ops.Clamp():
            return functions.helper("clamp", operands)
        case ops.Compare(relation):
            # in constant time a comparison is a word of its own, that no branch may be made of
            return functions.truth(Binary(relation.value, *operands))
        case ops.Select():
            return functions.select(kind, *operands)
        case ops.Apply(function):
            return functions.apply(function, operands)
        case _:
            assert_never(op)


def expression_size(expression: Expression) -> int:
    """Number of operations and calls in an expression; indexing counts nothing."""
    match expression:
        case Name() | Real() | Integer() | Unsigned() | Truth() | Member() | Element():
            return 0
        case Unary(_, operand) | Convert(_, operand):
            return 1 + expression_size(operand)
        case Binary(_, left, right):
            return 1 + expression_size(left) + expression_size(right)
        case Conditional(condition, then, otherwise):
            return 1 + sum(map(expression_size, (condition, then, otherwise)))
        case Call(_, arguments):
            return 1 + sum(map(expression_size, arguments))
        case _:
            assert_never(expression)
