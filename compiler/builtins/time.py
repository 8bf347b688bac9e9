"""Lowers builtins that involve time: `der(e)`, `integral(e)`, and the value of an expression at the
sample before (R5, R8). All raise LoweringFailed after reporting a mistake.
"""

from __future__ import annotations

from compiler.builtins.call_options import method_of, option, resolved
from compiler.ir.nodes import reads_simulation
from compiler.ir.ops import Relation
from compiler.ir.program import LayerMemory, NodeId, State
from compiler.ir.rules import product_unit, quotient_unit, same_unit
from compiler.ir.types import Type
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import START, Environment, EnvironmentPart
from compiler.lowering.expressions import lower, report_unit_conflicts
from compiler.lowering.places import fitted
from spec_schema.errors import calculus, names
from spec_schema.expressions.tree import Call, Name, expression_text
from spec_schema.units.parser import parse_unit


def earlier(context: Context, call: Call, environment: Environment) -> NodeId:
    """The node of the call's argument at t−1. In the first step, if its value before t0 is unknown,
    that at t0 is used instead.

    Signals are read one sample earlier where possible. A value that depends on a simulation with
    unknown past is stored in a state. Raises LoweringFailed after reporting a mistake.
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
    """The environment in which a call with memory, such as `integral`, is lowered: at t, constant
    during integrator stages (R6). Reports such a call in the start, in a constant or at another
    time, and raises LoweringFailed.
    """
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
    """The node of the argument of a call with memory. Reports an argument that is a window and
    raises LoweringFailed.
    """
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
    """Adds the state `name` in which a call with memory stores its value.

    `following` is the node of its value after the step, `start` that of its value before the first
    step, in the start graph. With `starts_fresh_each_run` every run initialises it in the same way.
    """
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
    """The node of the argument's value in the previous step, from a state; in the first step, of
    its value in this step.
    """
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


_SECOND = parse_unit("s")
_DERIVATIVE_METHODS = ("backward", "trapezoidal", "central", "forward")


def lower_derivative(context: Context, call: Call, environment: Environment) -> NodeId:
    """`der(e)`: the right-hand side if e is a continuous state; for other expressions a difference
    quotient, by `method=`.

    backward: (e[t] − e[t−1]) / dt. central: (e[t+1] − e[t−1]) / (2 dt). forward: (e[t+1] − e[t]) /
    dt. trapezoidal: d[t] = 2 (e[t] − e[t−1]) / dt − d[t−1] with d[t0−1] = 0. Raises LoweringFailed
    after reporting a mistake.
    """
    method = method_of(context, call, _DERIVATIVE_METHODS)
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
    """The derivative d[t] = 2 (e[t] − e[t−1]) / dt − d[t−1] of the argument e, with d[t0−1] = 0 and
    dt = `seconds`.

    The trapezoidal integral inverts it exactly. After a jump of e it oscillates without damping.
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
    """The node of the call's argument in an environment after t. Reports an argument that does not
    depend on the log only and raises LoweringFailed; `method` is named in the message.
    """
    argument = call.arguments[0]
    node = context.names.tried(lambda: lower(context, argument, environment))
    if node is None:
        lower(context, argument, environment.shifted(-environment.shift))  # its own mistake, if any
    if node is None or reads_simulation(context.builder(environment).graph(), node):
        context.findings.report(calculus.derivative_ahead(method, argument.span))
        raise LoweringFailed
    return node


_INTEGRAL_METHODS = ("euler", "trapezoidal")


def lower_integral(context: Context, call: Call, environment: Environment) -> NodeId:
    """`integral(e)`: I[t] = I[t−1] + dt·e[t] (`method=euler`), or I[t−1] + dt/2·(e[t] + e[t−1])
    (`trapezoidal`). I[t0−1] is `init=`, else 0. Raises LoweringFailed after reporting a mistake.
    """
    method = method_of(context, call, _INTEGRAL_METHODS)
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
    """The node of the initial value I[t0−1] in the start graph, with the axes and unit of `type`
    unless it is None. Raises LoweringFailed after reporting a mistake in `init=`.
    """
    builder = context.builder(START)
    init = option(call, "init")
    if init is None:
        node = builder.constant(0.0, unit=type.unit if type else None)
        return builder.broadcast(node, type.axes) if type else node
    node = lower(context, init, START)
    if type is None:
        return node
    return fitted(context, "`init` of `integral`", node, type, init, START)
