"""Units in program files: their text where it can be read back, else their factors."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from compiler.program_file.plain_data import Malformed, as_list, as_pair, as_text
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE, Unit, UnitError, unit_symbol

_MOST_FACTORS = 100
_LARGEST_POWER = 1000


def unit_to_data(unit: Unit) -> Any:
    """`"N*m"`; for what texts cannot say, as the root of a metre, `[["m", "1/2"]]`."""
    try:
        # roots of units have a text that nothing reads, and products may round their scale another
        # way
        readable = parse_unit(unit.text).same_as(unit)
    except UnitError:
        readable = False
    return unit.text if readable else [[symbol, str(power)] for symbol, power in unit.factors]


def unit_from_data(data: Any, place: str) -> Unit:
    """The unit of the data. Raises Malformed."""
    if isinstance(data, str):
        try:
            return parse_unit(data)
        except UnitError as error:
            raise Malformed(f"{place}: {error}") from error
    factors = as_list(data, place)
    if len(factors) > _MOST_FACTORS:
        raise Malformed(f"{place} has too many factors")
    unit = ONE
    for factor in factors:
        symbol, power = as_pair(factor, place)
        base = unit_symbol(as_text(symbol, place))
        if base is None:
            raise Malformed(f"{place} has an unknown symbol")
        unit = unit * base.power(_power(power, place))
    return unit


def _power(data: Any, place: str) -> Fraction:
    text = as_text(data, place)
    try:
        # the cap is on the text too, since a long number is slow to read
        power = Fraction(text) if len(text) < 20 else Fraction(_LARGEST_POWER + 1)
    except (ValueError, ZeroDivisionError) as error:
        raise Malformed(f"{place} has a power that is no fraction") from error
    if abs(power) > _LARGEST_POWER:
        raise Malformed(f"{place} has a power that is too large")
    return power
