"""Defines the precedence of formula parts, as LaTeX or MathML."""

from __future__ import annotations

from spec_schema.expressions.tree import (
    Binary,
    Compare,
    Expression,
    Negate,
    Number,
    Operator,
    number_text,
)

COMPARE, SUM, PRODUCT, POWER, ATOM = range(5)


def binding(expression: Expression) -> int:
    """The precedence of a formula, from COMPARE to ATOM; it tells where parentheses are needed."""
    match expression:
        case Compare():
            return COMPARE
        case Negate() | Binary(operator=Operator.ADD | Operator.SUBTRACT):
            return SUM
        # a quotient is none of these: the bar of its fraction encloses both sides
        case Binary(operator=Operator.MULTIPLY | Operator.CONTRACT):
            return PRODUCT
        case Binary():
            return POWER
        # `1e-3 x` is set as a product: as a base it needs parentheses
        case Number(value=value) if "e" in number_text(value):
            return PRODUCT
        case _:
            return ATOM


def binding_of_operands(operator: Operator) -> int:
    """The minimum precedence of the left operand of a sum or product; the right one needs more."""
    return SUM if operator in (Operator.ADD, Operator.SUBTRACT) else PRODUCT
