"""Lowers `grad(y, x)`, the gradient of a value y with respect to x at one sample (R8)."""

from __future__ import annotations

from compiler.builtins.call_options import resolved
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadLog, ReadSamples, ReadSignal
from compiler.ir.program import NodeId
from compiler.ir.rules import quotient_unit
from compiler.ir.types import WINDOW, Axis
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.expressions import lower, moving_input
from spec_schema.errors import calculus, names
from spec_schema.expressions.language import NUMBERS
from spec_schema.expressions.tree import (
    Call,
    Expression,
    Future,
    Member,
    Name,
    Past,
    Window,
    expression_text,
)
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.signals import Equation, Input, Output, Signal, State
from spec_schema.sections.values import Parameter


@dataclass(frozen=True)
class _Read:
    """A node that contains the samples t+first … t+last of the variable x."""

    node: NodeId
    first: int
    last: int


def lower_gradient(context: Context, call: Call, environment: Environment) -> NodeId:
    """`grad(y, x)`: the node of Σ ∂y/∂x[t] over all elements of y, with the axes of x.

    All dependencies of y on x[t] count: through equations, layers, windows and gradients. Past
    values in states and buffers count as constant. Raises LoweringFailed after reporting an x that
    is no variable or does not affect y.
    """
    if environment.part is EnvironmentPart.CONSTANT:
        context.findings.report(names.misplaced("grad", environment.part.value, call.function.span))
        raise LoweringFailed
    y_argument, x_argument = call.arguments
    y = lower(context, y_argument, environment)
    builder = context.builder(environment)
    whole, reads = _reads(context, x_argument, environment)
    used = context.gradients.made_of(builder, y)
    # reads without a sample in common with x do not contribute
    overlapping = [
        read
        for read in reads
        if read.node in used and read.first <= whole.last and whole.first <= read.last
    ]
    if not overlapping:
        text = expression_text(x_argument)
        context.findings.report(
            calculus.gradient_of_unrelated(text, x_argument.span, y_argument.span)
        )
        raise LoweringFailed
    from compiler.differentiation.reverse_mode import gradient_nodes  # few specs use gradients

    parts: list[NodeId] = []
    slopes = gradient_nodes(builder, y, [read.node for read in overlapping])
    for read, slope in zip(overlapping, slopes, strict=True):
        if slope is not None:
            parts.append(_placed(builder, slope, read, whole))
    # no gradient: y depends on x only through comparisons
    result = parts[0] if parts else _zero(builder, y, whole.node)
    for part in parts[1:]:
        result = builder.add(result, part)
    context.gradients.remember(builder, result, y)
    return result


def _reads(
    context: Context, expression: Expression, environment: Environment
) -> tuple[_Read, list[_Read]]:
    """The node of x as written in the call, and all nodes that contain some of its samples. Reports
    an x that is no variable, such as a parameter, and raises LoweringFailed.
    """
    named, there = resolved(expression, environment)
    # the operand of a window may be a function argument
    operand = named.operand if isinstance(named, Window | Past | Future) else named
    operand, _ = resolved(operand, there)
    entry = None
    if isinstance(operand, Member):
        entry = context.names.declared(operand.base, operand.span).entry
    elif isinstance(operand, Name) and operand.name not in ("dt", *NUMBERS):
        entry = context.names.declared(operand.name, operand.span).entry
    match entry:
        case Input() if isinstance(operand, Name):
            moving = moving_input(context, operand.name, entry, environment)
            return _of_signal(context, expression, environment, moving)
        case Signal():
            return _of_signal(context, expression, environment)
        case State() if isinstance(operand, Member):
            return _of_signal(context, expression, environment)
        case State() | Equation() | Output() if named is operand:
            assert isinstance(operand, Name)
            return _of_value(context, operand.name, expression, environment)
        case Parameter():
            repair = "training differentiates the losses with respect to parameters by itself"
            what = f"the parameter `{expression_text(operand)}`"
            context.findings.report(calculus.not_a_variable(what, expression.span, repair))
        case _:
            what = f"`{expression_text(expression)}`"
            context.findings.report(calculus.not_a_variable(what, expression.span))
    raise LoweringFailed


def _of_signal(
    context: Context,
    expression: Expression,
    environment: Environment,
    moving: NodeId | None = None,
) -> tuple[_Read, list[_Read]]:
    """The result of `_reads` for a signal or a window of one: all nodes that read it. Raises
    LoweringFailed after reporting a mistake in the expression.

    For an input that is interpolated between samples (`moving` is its node), only that value
    counts: windows contain samples, which do not depend on it.
    """
    node = lower(context, expression, environment)
    builder = context.builder(environment)
    if node == moving:
        whole = _Read(node, 0, 0)
        return whole, [whole]
    op = builder.node(node).op
    assert isinstance(op, ReadSamples)
    whole = _Read(node, op.first, op.last)
    reads: list[_Read] = []
    # includes reads of other values; `made_of` excludes them above
    for index, other in builder.graph():
        if isinstance(other.op, ReadSamples) and other.op.signal == op.signal:
            read = _Read(index, other.op.first, other.op.last)
            # for a single t every window with x[t] counts; over a window each sample of y has its
            # own x
            if environment.window is None or other.op in _alike(op):
                reads.append(read)
    return whole, reads


def _alike(op: ReadSignal | ReadLog) -> tuple[ReadSignal, ReadLog]:
    """The two operations that read the same samples as `op`: as input of the step, and from the
    log.
    """
    return ReadSignal(op.signal, op.first, op.last), ReadLog(op.signal, op.first, op.last)


def _of_value(
    context: Context, name: str, expression: Expression, environment: Environment
) -> tuple[_Read, list[_Read]]:
    """The result of `_reads` for the state, equation or output `name`: its node, and the windows
    over which it was lowered again. Raises LoweringFailed after reporting a mistake in the
    expression.
    """
    node = lower(context, expression, environment)
    builder = context.builder(environment)
    first, last = environment.window or (0, 0)
    whole = _Read(node, first + environment.shift, last + environment.shift)
    reads = [whole]
    if environment.window is None:
        for (shift, window), other in context.names.lowerings(name, environment):
            if window is not None and builder.type(other).window is not None:
                reads.append(_Read(other, window[0] + shift, window[1] + shift))
    return whole, reads


def _placed(builder: GraphBuilder, slope: NodeId, read: _Read, whole: _Read) -> NodeId:
    """The gradient `slope` with respect to the samples of `read`, placed among the samples of x
    (`whole`); it is 0 for samples that `read` lacks.
    """
    first, last = max(read.first, whole.first), min(read.last, whole.last)
    axes = builder.type(whole.node).axes
    if builder.type(slope).window is not None:
        slope = builder.slice(slope, WINDOW, first - read.first, last - read.first + 1)
    if builder.type(whole.node).window is None:
        return builder.reshape(slope, axes)
    one = tuple(axis for axis in axes if axis.name != WINDOW)
    slope = builder.reshape(slope, (*one, Axis(WINDOW, last - first + 1)))
    # y does not read the rest of the window: its gradient there is 0
    zero = builder.constant(0.0, unit=builder.type(slope).unit)
    parts: list[NodeId] = []
    if first > whole.first:
        parts.append(builder.broadcast(zero, (*one, Axis(WINDOW, first - whole.first))))
    parts.append(slope)
    if last < whole.last:
        parts.append(builder.broadcast(zero, (*one, Axis(WINDOW, whole.last - last))))
    return builder.concat(parts, WINDOW) if len(parts) > 1 else slope


def _zero(builder: GraphBuilder, y: NodeId, x: NodeId) -> NodeId:
    """The node of a zero gradient, with the axes of x and the unit of y / x, for a y that is
    piecewise constant in x.
    """
    unit = quotient_unit(builder.type(y).unit, builder.type(x).unit)
    return builder.broadcast(builder.constant(0.0, unit=unit), builder.type(x).axes)
