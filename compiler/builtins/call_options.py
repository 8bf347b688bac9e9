"""Reads the keywords of calls of builtins, and finds the expression behind an argument of a
function of the spec.
"""

from __future__ import annotations

from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment
from spec_schema.errors import calculus
from spec_schema.expressions.tree import Call, Expression, Name, expression_text


def option(call: Call, name: str) -> Expression | None:
    """The expression of the keyword `name` of a call; None if the call lacks it."""
    return next((keyword.value for keyword in call.keywords if keyword.name == name), None)


def method_of(context: Context, call: Call, methods: tuple[str, ...]) -> str:
    """The value of the keyword `method=`; by default the first of `methods`. Reports a name that is
    not in `methods` and raises LoweringFailed.
    """
    given = option(call, "method")
    if given is None:
        return methods[0]
    word = expression_text(given)
    if not isinstance(given, Name) or word not in methods:
        function = expression_text(call.function)
        context.findings.report(calculus.unknown_method(function, word, methods, given.span))
        raise LoweringFailed
    return word


def resolved(expression: Expression, environment: Environment) -> tuple[Expression, Environment]:
    """The expression of the call, and its environment at the same time, if `expression` is an
    argument of a function of the spec that is being inlined. Otherwise both unchanged.
    """
    while isinstance(expression, Name) and expression.name in environment.arguments:
        argument = environment.arguments[expression.name]
        environment = argument.environment.at_time_of(environment)
        expression = argument.expression
    return expression, environment
