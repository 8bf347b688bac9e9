"""Rounds a product and the sum that it is added to once: the emitter decides where, no compiler.

A processor multiplies and adds in one instruction, with one rounding. Compilers may use it wherever
they like, and each likes other places: then the same kernel trains to other bits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from backends.c_language.tree import (
    Assign,
    Binary,
    Call,
    Comment,
    Conditional,
    ConstantTable,
    Convert,
    Declare,
    Discard,
    Element,
    Evaluate,
    Expression,
    Function,
    If,
    Integer,
    Loop,
    Member,
    Name,
    Real,
    Return,
    SetBits,
    Statement,
    Truth,
    Unary,
    Unsigned,
)

FUSED = "fused"
"""a · b + c rounded once, in the kernel's prelude."""


def with_fused_products(function: Function) -> Function:
    """The function with `fused` wherever a term of a sum or difference is written as a product.

    Of two products the right one is fused: a·b + c·d becomes fused(c, d, a·b).
    """
    return replace(function, body=_block(function.body))


def _block(statements: tuple[Statement, ...]) -> tuple[Statement, ...]:
    return tuple(map(_statement, statements))


def _statement(statement: Statement) -> Statement:
    match statement:
        case Declare(value=value, elements=elements):
            value = None if value is None else _expression(value)
            return replace(statement, value=value, elements=tuple(map(_expression, elements)))
        case Assign() | Evaluate() | Return():
            return replace(statement, value=_expression(statement.value))
        case Loop():
            return replace(statement, body=_block(statement.body))
        case If(condition, then, otherwise):
            return If(_expression(condition), _block(then), _block(otherwise))
        case ConstantTable() | SetBits() | Discard() | Comment():
            return statement
        case _:
            assert_never(statement)


def _expression(expression: Expression) -> Expression:
    match expression:
        case Binary("+" | "-" as operator, left, right):
            negative = operator == "-"
            # a − b·c is fused(−b, c, a): a changed sign rounds nothing
            if (factors := _factors(right, negative=negative)) is not None:
                return Call(FUSED, (*factors, _expression(left)))
            if (factors := _factors(left)) is not None:
                added = _expression(right)
                # a·b − c is fused(a, b, −c)
                return Call(FUSED, (*factors, Unary("-", added) if negative else added))
            return Binary(operator, _expression(left), _expression(right))
        case Binary(operator, left, right):
            return Binary(operator, _expression(left), _expression(right))
        case Unary() | Convert():
            return replace(expression, operand=_expression(expression.operand))
        case Conditional(condition, then, otherwise):
            return Conditional(_expression(condition), _expression(then), _expression(otherwise))
        case Call(function, arguments):
            return Call(function, tuple(map(_expression, arguments)))
        case Name() | Real() | Integer() | Unsigned() | Truth() | Member() | Element():
            return expression
        case _:
            assert_never(expression)


def _factors(
    expression: Expression, *, negative: bool = False
) -> tuple[Expression, Expression] | None:
    """Two factors whose product the expression is, or its negative; None if it is no product."""
    match expression:
        case Unary("-", operand):
            return _factors(operand, negative=not negative)
        case Binary("*", left, right):
            # the sign goes to a factor: −(a·b) rounded is (−a)·b rounded
            first = _expression(left)
            return Unary("-", first) if negative else first, _expression(right)
        case _:
            return None
