"""Gives values the axes and the unit that their entry declares or that the predicted signal has."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.ir.program import NodeId
from compiler.ir.rules import same_unit
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import UNNAMED, Axis, Prediction, Type, describe_axes
from compiler.lowering.context import Context, Kind, LoweringFailed
from compiler.lowering.environment import STEP, Environment
from compiler.lowering.expressions import lower, report_declared_unit
from spec_schema.errors import names, shapes, states
from spec_schema.expressions.tree import Binary, Call, Compare, Expression, Name, Negate, Operator
from spec_schema.fields.formulas import Prediction as PredictionEntry
from spec_schema.sections.signals import Output as OutputEntry
from spec_schema.sections.signals import Signal as SignalEntry
from spec_schema.sections.signals import State as StateEntry


def fitted(
    context: Context,
    what: str,
    node: NodeId,
    type: Type,
    expression: Expression,
    environment: Environment,
) -> NodeId:
    """The node of a value, brought to exactly the axes of `type`, and to its unit if it has none.

    `node` is the value of `expression` in this environment. It is repeated along axes that it
    lacks. Axes that `type` lacks are reported under the name `what`, and LoweringFailed is raised.
    """
    builder = context.builder(environment)
    if not set(builder.type(node).axes) <= set(type.axes):
        report_surplus(context, what, node, type.axes, expression, environment)
        raise LoweringFailed
    if builder.type(node).unit is None:
        builder.set_unit(node, type.unit)
    return builder.broadcast(node, type.axes)


_LOGGED = (Kind.INPUT, Kind.TARGET, Kind.STATE)


def prediction_of(context: Context, predicts: PredictionEntry, key: str) -> Prediction:
    """The recorded sample, as a signal and an offset ahead of t, that a setting such as `predicts:
    "y[t+1]"` names; `key` is the setting's name in messages.

    Raises LoweringFailed after reporting a name that is no input, target or state.
    """
    signal = predicts.signal
    declared = context.scope.get(signal.value)
    if declared is None:
        known = [n for n, d in context.scope.items() if d.kind in _LOGGED]
        context.findings.report(
            names.unknown_name(signal.value, signal.span, known, "an input, target or state")
        )
        raise LoweringFailed
    if declared.kind not in _LOGGED:
        context.findings.report(states.no_such_prediction(key, signal.value, signal.span))
        raise LoweringFailed
    context.used.add(signal.value)
    if declared.kind is Kind.STATE:
        context.measured.setdefault(signal.value, context.spec.states[signal.value])
    return Prediction(signal.value, context.sampling.samples(predicts.ahead))


def as_predicted(
    context: Context, name: str, entry: OutputEntry, node: int, predicts: Prediction
) -> int:
    """The node of the output `name` with the axes of the signal that it predicts, and with its unit
    if the output has none. Other axes or units are reported.
    """
    builder = context.builder(STEP)
    signal = context.scope[predicts.signal].entry
    assert isinstance(signal, SignalEntry | StateEntry)
    target = context.axes_of(signal)
    if not set(builder.type(node).axes) <= set(target):
        what = f"`{name}`, which predicts `{predicts.signal}`,"
        report_surplus(context, what, node, target, entry.expr, STEP)
        return node
    unit = signal.unit.value if signal.unit else None
    own = builder.type(node).unit
    if own is None:
        builder.set_unit(node, unit)
    elif unit is not None and not same_unit(own, unit):
        report_declared_unit(context, name, own, unit, entry.expr.span)
    return builder.broadcast(node, target)


# the axes of their results are those of their operands, so one operand is at fault
_ELEMENTWISE = frozenset(
    {*SCALAR_FUNCTIONS, "min", "max", "clip", "where", "relu", "elu", "sech", "smooth_sign"}
)


def report_surplus(
    context: Context,
    what: str,
    node: NodeId,
    wanted: Sequence[Axis],
    expression: Expression,
    environment: Environment,
) -> None:
    """Reports that the value `node` of `expression` has axes that are not among `wanted`; `what`
    names the value in the message.

    The message points to the operand that brings the axis: in `bias + sum(q) + q` to the last term.
    The search descends into operands as long as exactly one of them adds such an axis.
    """
    builder = context.builder(environment)
    found = describe_axes(builder.type(node).axes)
    place, operand = expression, found
    while True:
        bringing = [
            (one, axes)
            for one in _operands(context, place)
            if not set(axes := _axes(context, one, environment)) <= set(wanted)
        ]
        if len(bringing) != 1:
            break
        place, operand = bringing[0][0], describe_axes(bringing[0][1])
    repair = _repair(builder.type(node).axes, wanted)
    context.findings.report(
        shapes.wrong_axes(
            what, describe_axes(tuple(wanted)), found, place.span, repair, operand=operand
        )
    )


def _repair(axes: Sequence[Axis], wanted: Sequence[Axis]) -> str | None:
    """A repair as text for a list that has the length of the axis in `wanted` but no dimension;
    None otherwise.
    """
    if len(axes) == len(wanted) == 1 and axes[0] == Axis(UNNAMED, wanted[0].size):
        return f"a list has no dim: declare it as a constant with `dims: {wanted[0].name}`"
    return None


def _operands(context: Context, expression: Expression) -> tuple[Expression, ...]:
    """The operand expressions of an elementwise operation; empty for any other expression."""
    match expression:
        case Negate(operand=operand):
            return (operand,)
        case Binary(operator=operator, left=left, right=right):
            return () if operator is Operator.CONTRACT else (left, right)
        case Compare(left=left, right=right):
            return left, right
        case Call(function=Name(name=name), arguments=arguments):
            return arguments if name in _ELEMENTWISE and name not in context.scope else ()
        case _:
            return ()


def _axes(context: Context, operand: Expression, environment: Environment) -> tuple[Axis, ...]:
    node = context.names.tried(lambda: lower(context, operand, environment))
    return () if node is None else context.builder(environment).type(node).axes
