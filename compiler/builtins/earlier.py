"""Computes the value that an expression had one sample ago (R5, R8)."""

from __future__ import annotations

from compiler.ir.ops import Relation
from compiler.ir.program import LayerMemory, NodeId, State
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.environment import START, Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import calculus, names
from spec_schema.expressions.text import expression_text
from spec_schema.expressions.tree import Call


def earlier(context: Context, call: Call, environment: Environment) -> NodeId:
    """The argument of a call at t−1. If its value before t0 is unknown, that at t0 is used instead.

    Signals are read one sample earlier where possible. A value that depends on a simulation with
    unknown past is stored in a state.
    """
    argument = call.arguments[0]
    before = environment.shifted(-1)
    if environment.part is EnvironmentPart.START or environment.latest > 0:
        lower(context, argument, environment)  # reports mistakes at time t first
        return lower(context, argument, before)
    # if it can be lowered in the start graph, its past is known from the log
    known = context.names.tried(lambda: lower(context, argument, before.at_start()))
    if known is not None:
        return lower(context, argument, before)
    return _remembered(context, call, environment)


def in_the_step(context: Context, call: Call, environment: Environment) -> Environment:
    """The environment of a call with memory: at t, constant over integrator stages (R6)."""
    function = call.function
    name = expression_text(function)
    if environment.part is EnvironmentPart.START or environment.part is EnvironmentPart.CONSTANT:
        place = environment.part.value
        context.findings.report(names.misplaced(name, place, function.span))
        raise LoweringFailed
    if environment.is_elsewhere:
        context.findings.report(calculus.memory_at_another_time(name, call.span))
        raise LoweringFailed
    if environment.stage is not None and environment.arguments:
        where = "a function that a vector field calls"
        context.findings.report(names.misplaced(name, where, function.span))
        raise LoweringFailed
    return environment.without_stage()


def one_sample(context: Context, call: Call, environment: Environment) -> NodeId:
    """The argument of a call with memory. Raises LoweringFailed if it is a window."""
    argument = call.arguments[0]
    node = lower(context, argument, environment)
    if context.builder(environment).type(node).window is not None:
        name = expression_text(call.function)
        context.findings.report(calculus.memory_of_window(name, argument.span))
        raise LoweringFailed
    return node


def keep(
    context: Context,
    call: Call,
    name: str,
    following: NodeId,
    start: NodeId,
    environment: Environment,
    *,
    starts_fresh_each_run: bool = False,
) -> None:
    """Adds the state of a call; `start` is a node of the start graph."""
    type = context.builder(environment).type(following)
    doc = f"memory of {expression_text(call)}"
    context.memories.keep(
        State(
            name=name,
            axes=type.axes,
            unit=type.unit,
            origin=LayerMemory(starts_fresh_each_run),
            next=following,
            start=start,
            range=None,
            doc=doc,
            span=call.span,
        )
    )


def _remembered(context: Context, call: Call, environment: Environment) -> NodeId:
    """The value of the previous step, from a state; in the first step, the value of this step."""
    environment = in_the_step(context, call, environment)
    now = one_sample(context, call, environment)
    builder, start = context.builder(environment), context.builder(START)
    type = builder.type(now)
    name = context.memories.name("previous", (now,))
    # never used: the first step selects its own value
    zero = start.broadcast(start.constant(0.0, unit=type.unit), type.axes)
    keep(context, call, name, now, zero, environment, starts_fresh_each_run=True)
    first = context.memories.name("first_step", ())
    context.memories.keep(
        State(
            name=first,
            axes=(),
            unit=None,
            origin=LayerMemory(starts_fresh_each_run=True),
            # 0 from the second step on
            next=builder.constant(0.0, unit=None),
            start=start.constant(1.0, unit=None),
            range=None,
            doc="1 in the first step of a run",
        )
    )
    begins = builder.compare(
        Relation.GREATER, builder.state(first, Type()), builder.constant(0.5, unit=None)
    )
    return builder.select(begins, now, builder.state(name, type))
