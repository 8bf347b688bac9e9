"""Splits the expression of a loss into terms: measures with constant factors."""

from __future__ import annotations

from compiler.lowering.constants import number, refuse_infinite
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.language import LOSS_FUNCTIONS
from spec_schema.expressions.tree import Binary, Call, Expression, Name, Negate, Operator
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True)
class CostTerm:
    """`share` times a measure, or times an expression that is a cost itself."""

    share: float
    expression: Expression
    function: str | None
    """The name of the measure; None for a cost."""


def terms_of(context: Context, expression: Expression) -> list[CostTerm]:
    """Splits a loss into its terms. Reports any other arithmetic and raises LoweringFailed.

    `mse(a, b) + 0.1 * mae(c) / 2` has the terms 1 · mse(a, b) and 0.05 · mae(c). An expression
    without a measure is a single cost.
    """
    measure = _measure_in(context, expression)
    # already a cost: it is lowered as a whole and averaged over the samples
    if measure is None:
        return [CostTerm(1.0, expression, None)]
    match expression:
        case Call() as call if call is measure:
            assert isinstance(call.function, Name)
            return [CostTerm(1.0, call, call.function.name)]
        case Negate(operand=operand):
            # a negative share is a reward; the total may be negative
            return _scaled(context, -1.0, terms_of(context, operand))
        case Binary(operator=Operator.ADD | Operator.SUBTRACT as operator):
            sign = 1.0 if operator is Operator.ADD else -1.0
            left = terms_of(context, expression.left)
            return left + _scaled(context, sign, terms_of(context, expression.right))
        case Binary(operator=Operator.MULTIPLY, left=left, right=right):
            factor, rest = left, right
            # `0.1 * mse(…)` and `mse(…) * 0.1` are equal; a product of two measures is refused
            if _measure_in(context, left) is not None:
                factor, rest = right, left
            if _measure_in(context, factor) is None:
                return _scaled(context, _number(context, factor), terms_of(context, rest))
        # a measure in a denominator is refused at the end
        case Binary(operator=Operator.DIVIDE, left=left, right=right):
            if _measure_in(context, right) is None:
                divisor = _number(context, right)
                if divisor == 0:
                    place = right.span
                    report = names.unfit_constant("the divisor", "is 0", place)
                    context.findings.report(report)
                    raise LoweringFailed
                return _scaled(context, 1 / divisor, terms_of(context, left))
        case _:
            pass
    assert isinstance(measure.function, Name)
    repair = "a loss is a sum of measures, each times a number"
    where = "this arithmetic"
    report = names.misplaced(measure.function.name, where, measure.function.span, repair)
    context.findings.report(report)
    raise LoweringFailed


def _number(context: Context, expression: Expression) -> float:
    return number(context, expression, "the factor of a loss")


def _scaled(context: Context, factor: float, terms: list[CostTerm]) -> list[CostTerm]:
    for term in terms:
        # a product of finite factors, or a quotient by 1e-320, can overflow
        place = term.expression.span
        refuse_infinite(context, "the factor of this measure", factor * term.share, place)
    return [CostTerm(factor * term.share, term.expression, term.function) for term in terms]


def _measure_in(context: Context, expression: Expression) -> Call | None:
    """The first call of a measure in an expression, or None."""
    match expression:
        case Call(function=Name(name=name)) as call if (
            name in LOSS_FUNCTIONS and name not in context.scope
        ):
            return call
        case Call(arguments=arguments, keywords=keywords):
            parts = (*arguments, *(keyword.value for keyword in keywords))
        case Binary(left=left, right=right):
            parts = (left, right)
        case Negate(operand=operand):
            parts = (operand,)
        case _:
            parts = ()
    found = (_measure_in(context, part) for part in parts)
    return next((call for call in found if call is not None), None)
