"""What outputs predict, and the axes and unit that they have from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.ir.program import Prediction
from compiler.ir.rules.unit_rules import same_unit
from compiler.ir.types import describe_axes
from compiler.lowering.environment import Environment, Part
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.scope import Kind
from spec_schema.errors import names, shapes, states, units
from spec_schema.fields.formulas import Prediction as PredictionEntry
from spec_schema.sections.signals import Output as OutputEntry
from spec_schema.sections.signals import Signal as SignalEntry
from spec_schema.sections.signals import State as StateEntry

if TYPE_CHECKING:
    from compiler.elaboration.names import Model

_STEP = Environment(Part.STEP)
_LOGGED = (Kind.INPUT, Kind.TARGET, Kind.STATE)


def prediction_of(model: Model, predicts: PredictionEntry, key: str) -> Prediction:
    """The logged sample that a key, such as `predicts`, names; reports what is not logged."""
    signal = predicts.signal
    declared = model.scope.get(signal.value)
    if declared is None:
        known = [n for n, d in model.scope.items() if d.kind in _LOGGED]
        model.findings.report(
            names.unknown_name(signal.value, signal.span, known, "an input, target or state")
        )
        raise LoweringFailed
    if declared.kind not in _LOGGED:
        model.findings.report(states.no_such_prediction(key, signal.value, signal.span))
        raise LoweringFailed
    model.used.add(signal.value)
    if declared.kind is Kind.STATE:
        model.measured.setdefault(signal.value, model.spec.states[signal.value])
    return Prediction(signal.value, model.sampling.samples(predicts.ahead))


def as_predicted(
    model: Model, name: str, entry: OutputEntry, node: int, predicts: Prediction
) -> int:
    """The output's node with the axes and, where it had none, the unit of what it predicts."""
    builder = model.builder(_STEP)
    signal = model.scope[predicts.signal].entry
    assert isinstance(signal, SignalEntry | StateEntry)
    wanted = model.arrays.axes_of(signal)
    found = builder.type(node).axes
    if not set(found) <= set(wanted):
        model.findings.report(
            shapes.wrong_axes(
                f"`{name}`, which predicts `{predicts.signal}`,",
                describe_axes(wanted),
                describe_axes(found),
                entry.expr.span,
            )
        )
        return node
    unit = signal.unit.value if signal.unit else None
    own = builder.type(node).unit
    if own is None:
        builder.set_unit(node, unit)
    elif unit is not None and not same_unit(own, unit):
        model.findings.report(
            units.declared_unit_differs(name, own.text, unit.text, entry.expr.span)
        )
    return builder.broadcast(node, wanted)
