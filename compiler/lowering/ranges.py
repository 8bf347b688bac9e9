"""Converts declared ranges to the unit of their values, and collects ranges of equations."""

from __future__ import annotations

import math

from compiler.ir.program import Expected
from compiler.linking.connected import Connected
from compiler.lowering.context import Context
from compiler.lowering.environment import STEP
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import schema
from spec_schema.sections.signals import Equation
from spec_schema.units.conversion import converted
from spec_schema.units.quantity import Quantity, Range
from spec_schema.units.unit import Unit


def range_in(
    context: Context, range: Range | None, unit: Unit | None
) -> tuple[float, float] | None:
    """A declared range in the unit of the value; a bare number is already in it.

    Raises LoweringFailed after reporting a unit of another dimension or an empty range.
    """
    if range is None:
        return None
    low, high = (limit_in(context, limit, unit) for limit in (range.low, range.high))
    if low >= high:
        context.findings.report(schema.reversed_range(range.low.text, range.high.text, range.span))
        raise LoweringFailed
    # checks, tests and controllers draw samples from the whole range and need its width
    if not math.isfinite(high - low):
        text, wanted = f"{range.low.text} … {range.high.text}", "a range whose width is a number"
        context.findings.report(schema.out_of_range(text, range.span, wanted))
        raise LoweringFailed
    return low, high


def limit_in(context: Context, limit: Quantity, unit: Unit | None) -> float:
    """A limit in the unit of the limited value. Raises LoweringFailed as above."""
    number = converted(limit, unit, context.findings)
    if number is None:
        raise LoweringFailed
    return number


def width_in(context: Context, width: Quantity, unit: Unit | None) -> float:
    """A difference of two values in their unit, without the offset of units such as degC."""
    number = converted(width, unit, context.findings, is_distance=True)
    if number is None:
        raise LoweringFailed
    return number


def signal_ranges(context: Context) -> dict[str, tuple[float, float]]:
    """The ranges of all inputs, targets and states, by name."""
    ranges: dict[str, tuple[float, float]] = {}
    for entries in (context.spec.inputs, context.spec.targets, context.spec.states):
        for name, entry in entries.items():
            unit = entry.unit.value if entry.unit else None
            try:
                limits = range_in(context, entry.range, unit)
            except LoweringFailed:
                continue
            if limits is not None:
                ranges[name] = limits
    return ranges


def expected_values(context: Context) -> list[Expected]:
    """The expected ranges of equations, and of values connected to inputs that have a range."""
    builder = context.builder(STEP)
    expected: list[Expected] = []
    for name, entry in context.spec.equations.items():
        declared = _range_of(entry)
        # a node that several times share counts once
        nodes = list(dict.fromkeys(node for _, node in context.names.lowerings(name, STEP)))
        if declared is None or not nodes:
            continue
        try:
            # an equation without declared unit has the unit of its formula
            limits = range_in(context, declared, builder.type(nodes[0]).unit)
        except LoweringFailed:
            continue
        assert limits is not None
        expected += [Expected(name, node, limits, entry.place.key) for node in nodes]
    return expected


def _range_of(entry: Equation) -> Range | None:
    if isinstance(entry, Connected):
        return entry.feeds.range
    return entry.range
