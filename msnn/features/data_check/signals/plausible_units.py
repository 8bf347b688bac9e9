"""Detects units whose values would be more plausible in another unit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True)
class Doubt:
    """A rule: values of a signal from `low` to `high` in `unit` are suspicious.

    The values are more plausible in the unit `rather`.
    """

    unit: str
    low: float
    high: float
    rather: str
    reason: str

    def holds(self, unit: Unit, low: float, high: float) -> bool:
        """True if all values of a signal, low … high, are in this range."""
        return unit.same_as(parse_unit(self.unit)) and self.low <= low and high <= self.high


DOUBTS = (
    # unit, low, high, rather, reason
    Doubt("K", -60.0, 150.0, "degC", "is below −120 °C"),
    Doubt("degC", 250.0, 450.0, "K", "is hotter than 250 °C all the time"),
    Doubt("Pa", 0.05, 50.0, "bar", "is a vacuum"),
    Doubt("bar", 5e4, 5e6, "Pa", "is more than 50000 bar"),
)
"""Suspicious ranges [low, high]; the reason states what the values would mean."""

_SIX_TURNS = 12 * math.pi


def doubt(unit: Unit | None, low: float, high: float) -> tuple[str, str] | None:
    """The more plausible unit of values from `low` to `high`, and the reason; None if plausible."""
    if unit is None or low == high:
        return None
    # the largest magnitude: angles may go either way
    largest = max(-low, high)
    if unit.text == "rad" and _SIX_TURNS < largest <= 360.0:
        return "deg", "is more than six turns"
    for row in DOUBTS:
        if row.holds(unit, low, high):
            return row.rather, row.reason
    return None
