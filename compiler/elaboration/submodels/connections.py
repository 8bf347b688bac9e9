"""Gives a value that is connected to an input of a sub-model the dims and unit of the input."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import same_unit
from compiler.ir.types import WINDOW, describe_axes
from compiler.linking.connected import Connected
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import submodels as errors


def fitted_to_input(
    context: Context,
    builder: GraphBuilder,
    node: NodeId,
    name: str,
    entry: Connected,
    environment: Environment,
) -> NodeId:
    """The value with exactly the axes of the input; it is repeated along missing axes.

    Diagnostics about axes or units show both places, which are in two files.
    """
    signal = entry.feeds
    declaration = signal.place.key
    target = context.axes_of(signal)
    found = builder.type(node)
    is_window = environment.window is not None
    window = tuple(axis for axis in found.axes if axis.name == WINDOW and is_window)
    if not set(found.axes) <= {*target, *window}:
        expected, actual = describe_axes(target), describe_axes(found.axes)
        place = entry.expr.span
        context.findings.report(errors.connection_axes(name, expected, actual, place, declaration))
        raise LoweringFailed
    if signal.unit is not None:
        unit = signal.unit.value
        if found.unit is None:
            builder.set_unit(node, unit)
        elif not same_unit(found.unit, unit):
            place = entry.expr.span
            context.findings.report(
                errors.connection_unit(name, unit.text, found.unit.text, place, declaration)
            )
    return builder.broadcast(node, (*target, *window))
