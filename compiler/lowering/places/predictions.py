"""Relates outputs to the signals that they predict, which define their axes and unit."""

from __future__ import annotations

from compiler.ir.rules.unit_rules import same_unit
from compiler.ir.types import Prediction
from compiler.lowering.context import Context
from compiler.lowering.environment import STEP
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.surplus_axes import report_surplus
from compiler.lowering.scope import Kind
from compiler.lowering.unit_conflicts import report_declared_unit
from spec_schema.errors import names, states
from spec_schema.fields.formulas import Prediction as PredictionEntry
from spec_schema.sections.signals import Output as OutputEntry
from spec_schema.sections.signals import Signal as SignalEntry
from spec_schema.sections.signals import State as StateEntry

_LOGGED = (Kind.INPUT, Kind.TARGET, Kind.STATE)


def prediction_of(context: Context, predicts: PredictionEntry, key: str) -> Prediction:
    """The recorded sample that a key such as `predicts` names; reports a name without recording."""
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
    """The node of an output with the axes, and if it had none the unit, of the predicted signal."""
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
