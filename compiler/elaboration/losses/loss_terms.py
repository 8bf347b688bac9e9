"""Takes the expression of a loss apart: a sum of measures, each times a number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.language import LOSS_FUNCTIONS
from spec_schema.expressions.tree import Binary, Call, Expression, Name, Negate, Operator

if TYPE_CHECKING:
    from compiler.elaboration.names import Model


@dataclass(frozen=True)
class Term:
    """`share` times a measure, or times an expression that is a cost already."""

    share: float
    expression: Expression
    function: str | None
    """The measure, None for a cost."""


def terms_of(model: Model, expression: Expression) -> list[Term]:
    """The terms of a loss. LoweringFailed for any other arithmetic.

    `mse(a, b) + 0.1 * mae(c) / 2` has the terms 1 · mse(a, b) and 0.05 · mae(c). An expression
    without a measure is one cost.
    """
    measure = _measure_in(model, expression)
    if measure is None:
        return [Term(1.0, expression, None)]
    match expression:
        case Call() as call if call is measure:
            assert isinstance(call.function, Name)
            return [Term(1.0, call, call.function.name)]
        case Negate(operand=operand):
            return _scaled(-1.0, terms_of(model, operand))
        case Binary(operator=Operator.ADD | Operator.SUBTRACT as operator):
            sign = 1.0 if operator is Operator.ADD else -1.0
            left = terms_of(model, expression.left)
            return left + _scaled(sign, terms_of(model, expression.right))
        case Binary(operator=Operator.MULTIPLY, left=left, right=right):
            factor, rest = left, right
            if _measure_in(model, left) is not None:
                factor, rest = right, left
            if _measure_in(model, factor) is None:
                return _scaled(_number(model, factor), terms_of(model, rest))
        case Binary(operator=Operator.DIVIDE, left=left, right=right):
            if _measure_in(model, right) is None:
                divisor = _number(model, right)
                if divisor == 0:
                    place = right.span
                    report = names.unfit_constant("the divisor", "is 0", place)
                    model.findings.report(report)
                    raise LoweringFailed
                return _scaled(1 / divisor, terms_of(model, left))
        case _:
            pass
    assert isinstance(measure.function, Name)
    repair = "a loss is a sum of measures, each times a number"
    where = "this arithmetic"
    report = names.misplaced(measure.function.name, where, measure.function.span, repair)
    model.findings.report(report)
    raise LoweringFailed


def _number(model: Model, expression: Expression) -> float:
    return model.constants.number(expression, "the factor of a loss")


def _scaled(factor: float, terms: list[Term]) -> list[Term]:
    return [Term(factor * term.share, term.expression, term.function) for term in terms]


def _measure_in(model: Model, expression: Expression) -> Call | None:
    """The first call of a measure in an expression."""
    match expression:
        case Call(function=Name(name=name)) as call if (
            name in LOSS_FUNCTIONS and name not in model.scope
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
    found = (_measure_in(model, part) for part in parts)
    return next((call for call in found if call is not None), None)
