"""The C expression of each elementwise operation, from the expressions of its operands."""

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
from compiler.ir.ops import (
    Add,
    Apply,
    Clamp,
    Compare,
    Divide,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Select,
    Subtract,
)
from compiler.ir.types import Kind

Elementwise = (
    Add
    | Subtract
    | Multiply
    | Divide
    | Negate
    | Minimum
    | Maximum
    | Clamp
    | Compare
    | Select
    | Apply
)


def scalar_operation(
    op: Elementwise,
    operands: tuple[Expression, ...],
    functions: FunctionTable,
    kind: Kind = "real",
) -> Expression:
    """One element of the operation's value, which is of that kind."""
    match op:
        case Add():
            return Binary("+", *operands)
        case Subtract():
            return Binary("-", *operands)
        case Multiply():
            return Binary("*", *operands)
        case Divide():
            return Binary("/", *operands)
        case Negate():
            return Unary("-", *operands)
        case Minimum():
            return functions.helper("minimum", operands)
        case Maximum():
            return functions.helper("maximum", operands)
        case Clamp():
            return functions.helper("clamp", operands)
        case Compare(relation):
            return functions.truth(Binary(relation.value, *operands))
        case Select():
            return functions.select(kind, *operands)
        case Apply(function):
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
