"""Finds conversions that may confuse revolutions with radians."""

from spec_schema.late_dataclass import dataclass
from spec_schema.units.table import BASE_SYMBOLS
from spec_schema.units.unit import Rational, Unit, unit_symbol

_HERTZ = "Hz"
_TURNS = frozenset(["rev", "rpm", "rps"])
_TIME, _ANGLE = BASE_SYMBOLS.index("s"), BASE_SYMBOLS.index("rad")


@dataclass(frozen=True)
class TurnReadings:
    """The two meanings of a unit that counts per time, beside a unit of angle per time.

    600 1/min are 600 rev/min = 62.8 rad/s (rotational frequency, ISO 80000-3), or 600 rad/min =
    10 rad/s (the radian as 1, SI brochure, section 5.4.8): they differ by 2π.
    """

    count: Unit
    """The one of the two units that names no angle."""
    in_revolutions: str
    in_radians: str

    @property
    def texts(self) -> tuple[str, str, str]:
        """The count, as revolutions, as radians."""
        return self.count.text, self.in_revolutions, self.in_radians


def turn_readings(unit: Unit, other: Unit) -> TurnReadings | None:
    """Both readings where a conversion between the units is right by one of them only, else None.

    `N*m/rad` is always `N*m`; `1/min` is not always `rad/min`.
    """
    if unit.angle == other.angle or not unit.same_dimension(other):
        return None
    pure = _is_per_time(unit) and _is_per_time(other)
    if not pure and not _names_turns(unit) and not _names_turns(other):
        return None
    count, angled = sorted((unit, other), key=lambda one: abs(one.angle))
    power = angled.angle - count.angle
    return TurnReadings(count, _times("rev", power, count), _times("rad", power, count))


def _is_per_time(unit: Unit) -> bool:
    others = (power for at, power in enumerate(unit.exponents) if at not in (_TIME, _ANGLE))
    return unit.exponents[_TIME] < 0 and not any(others)


def _names_turns(unit: Unit) -> bool:
    return any(symbol in _TURNS or symbol.endswith(_HERTZ) for symbol, _ in unit.factors)


def _times(angle: str, power: Rational, count: Unit) -> str:
    """The text of the count per time as one of angles: `rev/min` of `1/min`, `rad/s` of `Hz`."""
    product, second = unit_symbol(angle), unit_symbol("s")
    assert product is not None
    assert second is not None
    product = product.power(power)
    for symbol, exponent in count.factors:
        factor = second.power(-1) if symbol == _HERTZ else unit_symbol(symbol)
        assert factor is not None, "factors are symbols"
        product *= factor.power(exponent)
    return product.text
