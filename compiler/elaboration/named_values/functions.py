"""Inlines calls of the spec's functions; each argument is lowered where the formula uses it."""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, FunctionArgument
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Expression
from spec_schema.sections.values import Function


def inlined(
    context: Context, name: str, function: Function, call: Call, environment: Environment
) -> NodeId:
    """The value of a function's formula with the arguments of the call."""
    expressions = _arguments(context, name, function, call)
    # inlining a recursive function would not terminate
    if name in environment.functions:
        context.findings.report(names.recursive_function(name, call.function.span))
        raise LoweringFailed
    arguments = {key: FunctionArgument(value, environment) for key, value in expressions.items()}
    value = lower(context, function.expr, environment.inside(name, arguments))
    if environment.is_written:
        context.unread.extend(argument for argument in arguments.values() if not argument.lowered)
    return value


def argument_value(
    context: Context, argument: FunctionArgument, environment: Environment
) -> NodeId:
    """The value of an argument at the time of its use, with the names of the place of the call."""
    # the time suffices as key: part, stage and outer arguments are those of the call
    known = argument.lowered.get(environment.time)
    if known is None:
        there = argument.environment.at_time_of(environment)
        known = argument.lowered[environment.time] = lower(context, argument.expression, there)
    return known


def _arguments(
    context: Context, name: str, function: Function, call: Call
) -> dict[str, Expression]:
    """The expression of each argument, by name; arguments may be positional or keywords."""
    parameters = tuple(argument.value for argument in function.args)
    arguments: dict[str, Expression] = dict(zip(parameters, call.arguments, strict=False))
    for keyword in call.keywords:
        if keyword.name not in parameters or keyword.name in arguments:
            context.findings.report(
                names.unknown_keyword(name, keyword.name, keyword.span, parameters)
            )
            raise LoweringFailed
        arguments[keyword.name] = keyword.value
    found = len(call.arguments) + len(call.keywords)
    if found != len(parameters):
        plural = "s" if len(parameters) != 1 else ""
        expected = f"{len(parameters)} argument{plural} ({', '.join(parameters)})"
        context.findings.report(names.wrong_argument_count(name, expected, found, call.span))
        raise LoweringFailed
    return arguments
