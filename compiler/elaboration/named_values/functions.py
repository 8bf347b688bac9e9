"""Inlines calls of the spec's functions: formula in place, arguments where they are used."""

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
    """The value of a function's formula with the call's arguments."""
    given = _arguments(context, name, function, call)
    # a formula takes the place of its call: one that calls itself would grow without end
    if name in environment.functions:
        context.findings.report(names.recursive_function(name, call.function.span))
        raise LoweringFailed
    arguments = {key: FunctionArgument(value, environment) for key, value in given.items()}
    value = lower(context, function.expr, environment.inside(name, arguments))
    if environment.is_written:
        context.unread.extend(argument for argument in arguments.values() if not argument.lowered)
    return value


def argument_value(
    context: Context, argument: FunctionArgument, environment: Environment
) -> NodeId:
    """An argument at the time at which the formula uses it, in the names of the call's place."""
    # by time alone: part, stage and outer arguments are those of the place of the call
    known = argument.lowered.get(environment.time)
    if known is None:
        there = argument.environment.at_time_of(environment)
        known = argument.lowered[environment.time] = lower(context, argument.expression, there)
    return known


def _arguments(
    context: Context, name: str, function: Function, call: Call
) -> dict[str, Expression]:
    """The expression of each argument, by position and by name."""
    wanted = tuple(argument.value for argument in function.args)
    given: dict[str, Expression] = dict(zip(wanted, call.arguments, strict=False))
    for keyword in call.keywords:
        if keyword.name not in wanted or keyword.name in given:
            context.findings.report(names.unknown_keyword(name, keyword.name, keyword.span, wanted))
            raise LoweringFailed
        given[keyword.name] = keyword.value
    found = len(call.arguments) + len(call.keywords)
    if found != len(wanted):
        plural = "s" if len(wanted) != 1 else ""
        expected = f"{len(wanted)} argument{plural} ({', '.join(wanted)})"
        context.findings.report(names.wrong_argument_count(name, expected, found, call.span))
        raise LoweringFailed
    return given
