"""Lowers `integral(e)`, the time integral since the start of a run, with a state (R8)."""

from __future__ import annotations

from compiler.builtins.call_options import method_of, option
from compiler.builtins.earlier import earlier, in_the_step, keep, one_sample
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import product_unit, same_unit
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.environment import START, Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.places.fitted import fitted
from compiler.lowering.unit_conflicts import report_unit_conflicts
from spec_schema.expressions.tree import Call
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")
_METHODS = ("euler", "trapezoidal")


def lower_integral(context: Context, call: Call, environment: Environment) -> NodeId:
    """I[t] = I[t−1] + dt·e[t], or I[t−1] + dt/2·(e[t] + e[t−1]); I[t0−1] is `init=`, else 0."""
    method = method_of(context, call, _METHODS)
    if environment.part is EnvironmentPart.START and environment.time == (-1, None):
        # I[t0−1] is the initial value
        return _start(context, call, None)
    is_last = environment.time == (-1, None)
    now = in_the_step(context, call, environment.shifted(1) if is_last else environment)
    builder = context.builder(now)
    rate = one_sample(context, call, now)
    unit = product_unit(builder.type(rate).unit, _SECOND)
    type = Type(builder.type(rate).axes, unit)
    start = _start(context, call, type)
    if option(call, "init") is not None:
        begins = context.builder(START).type(start).unit
        # without a unit of the integrand the unit is that of `init=`; K/s from 20 degC is in degC
        if unit is None or (
            begins is not None and begins.offset != 0.0 and same_unit(unit, begins.difference)
        ):
            type = type.with_unit(begins)
    # the same integral written twice is one state
    name = context.memories.name("integral", (method, rate, start))
    last = builder.state(name, type)
    if method == "trapezoidal":
        before = earlier(context, call, now)
        both = builder.add(rate, before)
        increment = builder.multiply(_seconds(context, call, now, 0.5), both)
    else:
        increment = builder.multiply(_seconds(context, call, now, 1.0), rate)
    result = builder.add(last, increment)
    report_unit_conflicts(context, builder, call)
    builder.set_unit(result, type.unit)
    keep(context, call, name, result, start, now)
    return last if is_last else result


def _seconds(context: Context, call: Call, environment: Environment, share: float) -> NodeId:
    seconds = context.sampling.required("`integral`", call.span)
    return context.builder(environment).constant(share * seconds, unit=_SECOND)


def _start(context: Context, call: Call, type: Type | None) -> NodeId:
    """The node of I[t0−1] in the start graph, with the axes of `type` if given."""
    builder = context.builder(START)
    init = option(call, "init")
    if init is None:
        node = builder.constant(0.0, unit=type.unit if type else None)
        return builder.broadcast(node, type.axes) if type else node
    node = lower(context, init, START)
    if type is None:
        return node
    return fitted(context, "`init` of `integral`", node, type, init, START)
