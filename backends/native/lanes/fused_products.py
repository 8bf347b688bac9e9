"""Writes fused multiply-adds explicitly, so that no compiler chooses them.

A processor can multiply and add in one instruction with one rounding. Compilers choose different
places for it, so the same kernel would train to different bits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from backends.c_language import tree as c

FUSED = "fused"
"""a · b + c rounded once; defined in the kernel's prelude."""


def with_fused_products(function: c.Function) -> c.Function:
    """Uses `fused` for every sum or difference with a product as a term.

    For two products the right one is fused: a·b + c·d becomes fused(c, d, a·b).
    """
    return replace(function, body=_block(function.body))


def _block(statements: tuple[c.Statement, ...]) -> tuple[c.Statement, ...]:
    return tuple(map(_statement, statements))


def _statement(statement: c.Statement) -> c.Statement:
    match statement:
        case c.Declare(value=value, elements=elements):
            value = None if value is None else _expression(value)
            return replace(statement, value=value, elements=tuple(map(_expression, elements)))
        case c.Assign() | c.Evaluate() | c.Return():
            return replace(statement, value=_expression(statement.value))
        case c.Loop():
            return replace(statement, body=_block(statement.body))
        case c.If(condition, then, otherwise):
            return c.If(_expression(condition), _block(then), _block(otherwise))
        case c.ConstantTable() | c.SetBits() | c.Discard() | c.Comment():
            return statement
        case _:
            assert_never(statement)


def _expression(expression: c.Expression) -> c.Expression:
    match expression:
        case c.Binary("+" | "-" as operator, left, right):
            negative = operator == "-"
            # a − b·c is fused(−b, c, a): negation is exact
            if (factors := _factors(right, negative=negative)) is not None:
                return c.Call(FUSED, (*factors, _expression(left)))
            if (factors := _factors(left)) is not None:
                added = _expression(right)
                # a·b − c is fused(a, b, −c)
                return c.Call(FUSED, (*factors, c.Unary("-", added) if negative else added))
            return c.Binary(operator, _expression(left), _expression(right))
        case c.Binary(operator, left, right):
            return c.Binary(operator, _expression(left), _expression(right))
        case c.Unary() | c.Convert():
            return replace(expression, operand=_expression(expression.operand))
        case c.Conditional(condition, then, otherwise):
            return c.Conditional(_expression(condition), _expression(then), _expression(otherwise))
        case c.Call(function, arguments):
            return c.Call(function, tuple(map(_expression, arguments)))
        case (
            c.Name() | c.Real() | c.Integer() | c.Unsigned() | c.Truth() | c.Member() | c.Element()
        ):
            return expression
        case _:
            assert_never(expression)


def _factors(
    expression: c.Expression, *, negative: bool = False
) -> tuple[c.Expression, c.Expression] | None:
    """Two factors whose product, or negated product, is the expression; None for other
    expressions.
    """
    match expression:
        case c.Unary("-", operand):
            return _factors(operand, negative=not negative)
        case c.Binary("*", left, right):
            # the sign moves to a factor: −(a·b) and (−a)·b round identically
            first = _expression(left)
            return c.Unary("-", first) if negative else first, _expression(right)
        case _:
            return None
