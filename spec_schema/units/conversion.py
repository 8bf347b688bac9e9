"""Converts a quantity of a spec to the unit of its signal or parameter."""

import math

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema, units
from spec_schema.units.quantity import Quantity
from spec_schema.units.turns import turn_readings
from spec_schema.units.unit import Unit


def converted(
    quantity: Quantity, unit: Unit | None, findings: Findings, *, is_distance: bool = False
) -> float | None:
    """The number in this unit; a bare one is in it already, and what has no unit takes the number.

    Of a distance between two values scales alone count: 10 K wide is 10 degC wide. Gives None
    after reporting a unit of another dimension, a count per time for an angle per time, or a number
    that is beyond floats there.
    """
    if quantity.unit is None:
        return quantity.value
    if unit is None:
        report_unconverted(quantity, "nothing declares a unit here", findings)
        return quantity.value
    if not (quantity.unit.same_dimension if is_distance else quantity.unit.converts_to)(unit):
        fault = units.incomparable_unit(quantity.unit.text, unit.text, quantity.span)
        findings.report(fault)
        return None
    if (readings := turn_readings(quantity.unit, unit)) is not None:
        fault = units.turns_or_radians(
            quantity.unit.text, unit.text, *readings.texts, quantity.span
        )
        findings.report(fault)
        return None
    number = quantity.unit.convert(quantity.value, unit, is_distance=is_distance)
    if not math.isfinite(number):
        wanted = f"a number that is finite in {unit.text} too"
        findings.report(schema.out_of_range(quantity.text, quantity.span, wanted))
        return None
    return number


def report_unconverted(
    quantity: Quantity,
    reason: str,
    findings: Findings,
    secondary: tuple[tuple[Span, str], ...] = (),
) -> None:
    """Warns of a number without unit whose value differs in SI units."""
    unit = quantity.unit
    if unit is None or (quantity.value == unit.in_si(quantity.value) and not unit.is_level):
        return
    number = f"{quantity.value:.12g}"
    findings.report(
        units.unconverted(
            quantity.text, number, unit.text, unit.coherent, reason, quantity.span, secondary
        )
    )
