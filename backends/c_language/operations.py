"""Writes the C expression of each elementwise operation."""

from __future__ import annotations

from typing import assert_never

from backends.c_language import tree as c
from backends.c_language.functions import FunctionTable
from compiler.ir import ops
from compiler.ir.types import Kind


def scalar_operation(
    op: ops.Computed,
    operands: tuple[c.Expression, ...],
    functions: FunctionTable,
    kind: Kind = "real",
) -> c.Expression:
    """One element of the operation's value; `kind` is the type of a selected value."""
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
    """Number of operations and calls in an expression; indexing does not count."""
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
