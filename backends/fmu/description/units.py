"""Describes units to FMI: their symbols, and their conversion to SI base units."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element

from backends.fmu.description.xml_text import child, number_text
from spec_schema.units.unit import BASE_SYMBOLS, Unit


def add_units(root: Element, units: Iterable[Unit | None]) -> None:
    """Adds `UnitDefinitions` with each of these units once; adds nothing if there are none."""
    known = {unit.text: unit for unit in units if unit is not None}
    if not known:
        return
    definitions = child(root, "UnitDefinitions")
    for text in sorted(known):
        described = child(definitions, "Unit", {"name": text})
        base = _base(known[text])
        if base is not None:
            child(described, "BaseUnit", base)


def _base(unit: Unit) -> dict[str, str] | None:
    """SI value = factor · value + offset; None for units that FMI lacks: m^0.5, decibels."""
    # FMI's base units have integer powers
    if any(power != int(power) for power in unit.exponents):
        return None
    powers = zip(BASE_SYMBOLS, unit.exponents, strict=True)
    base = {symbol: str(int(power)) for symbol, power in powers if power}
    if "dB" in base:
        return None
    # FMI takes 1 and 0 where nothing is said
    if unit.scale != 1.0:
        base["factor"] = number_text(unit.scale)
    if unit.offset != 0.0:
        base["offset"] = number_text(unit.offset)
    return base
