"""Lowers `der(e)`, the time derivative, to difference quotients of samples (R8)."""

from __future__ import annotations

from compiler.builtins.call_options import method_of, option, resolved
from compiler.builtins.earlier import earlier, in_the_step, keep, one_sample
from compiler.ir.liveness import reads_simulation
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import quotient_unit
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.environment import START, Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.unit_conflicts import report_unit_conflicts
from spec_schema.errors import calculus
from spec_schema.expressions.tree import Call, Name
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")
_METHODS = ("backward", "trapezoidal", "central", "forward")


def lower_derivative(context: Context, call: Call, environment: Environment) -> NodeId:
    """The right-hand side of a continuous state; for other expressions a difference quotient.

    backward: (e[t] − e[t−1]) / dt. central: (e[t+1] − e[t−1]) / (2 dt). forward: (e[t+1] − e[t]) /
    dt. trapezoidal: d[t] = 2 (e[t] − e[t−1]) / dt − d[t−1] with d[t0−1] = 0.
    """
    method = method_of(context, call, _METHODS)
    argument, there = resolved(call.arguments[0], environment)
    state = context.spec.states.get(argument.name) if isinstance(argument, Name) else None
    if isinstance(argument, Name) and state is not None and state.der is not None:
        given = option(call, "method")
        if given is not None:
            context.findings.report(calculus.method_takes_state(argument.name, given.span))
            raise LoweringFailed
        context.used.add(argument.name)
        return context.names.derivative(argument.name, state, call.span, there)
    seconds = context.sampling.required("`der`", call.span)
    if environment.stage is not None:
        # integrator stages have no previous sample: the quotient is constant over the stages
        environment = in_the_step(context, call, environment)
    builder = context.builder(environment)
    dt = builder.constant(seconds, unit=_SECOND)
    match method:
        case "backward":
            before = earlier(context, call, environment)
            now = lower(context, call.arguments[0], environment)
            result = builder.divide(builder.subtract(now, before), dt)
        case "trapezoidal":
            return _trapezoidal(context, call, environment, seconds)
        case "forward":
            now = lower(context, call.arguments[0], environment)
            after = _logged(context, call, environment.shifted(1), method)
            result = builder.divide(builder.subtract(after, now), dt)
        case _:
            after = _logged(context, call, environment.shifted(1), method)
            before = lower(context, call.arguments[0], environment.shifted(-1))
            twice = builder.constant(2 * seconds, unit=_SECOND)
            result = builder.divide(builder.subtract(after, before), twice)
    report_unit_conflicts(context, builder, call)
    return result


def _trapezoidal(context: Context, call: Call, environment: Environment, seconds: float) -> NodeId:
    """The inverse of the trapezoidal integral.

    A disturbance at t0 oscillates for ever, undamped.
    """
    start = context.builder(START)
    # d[t0−1] = 0 by definition
    if environment.part is EnvironmentPart.START and environment.time == (-1, None):
        return start.constant(0.0, unit=None)
    is_last = environment.time == (-1, None)
    at_t = in_the_step(context, call, environment.shifted(1) if is_last else environment)
    builder = context.builder(at_t)
    now = one_sample(context, call, at_t)
    before = earlier(context, call, at_t)
    half = builder.constant(0.5 * seconds, unit=_SECOND)
    slope = builder.divide(builder.subtract(now, before), half)
    type = Type(builder.type(now).axes, quotient_unit(builder.type(now).unit, _SECOND))
    name = context.memories.name("derivative", (now,))
    last = builder.state(name, type)
    result = builder.subtract(slope, last)
    zero = start.broadcast(start.constant(0.0, unit=type.unit), type.axes)
    keep(context, call, name, result, zero, at_t)
    report_unit_conflicts(context, builder, call)
    return last if is_last else result


def _logged(context: Context, call: Call, environment: Environment, method: str) -> NodeId:
    """The argument at a sample after t. Raises LoweringFailed unless it depends on the log only."""
    argument = call.arguments[0]
    node = context.names.tried(lambda: lower(context, argument, environment))
    if node is None:
        lower(context, argument, environment.shifted(-environment.shift))  # its own mistake, if any
    if node is None or reads_simulation(context.builder(environment).graph(), node):
        context.findings.report(calculus.derivative_ahead(method, argument.span))
        raise LoweringFailed
    return node
