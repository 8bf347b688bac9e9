"""Represents numbers with a unit, and converts them to the unit of a signal."""

import math
from dataclasses import field

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema, units
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import BASE_SYMBOLS, Rational, Unit, unit_symbol


@dataclass(frozen=True)
class Quantity:
    """A number and its unit; `unit` is None if the user wrote only a number."""

    value: float
    unit: Unit | None
    span: Span = field(compare=False)

    @property
    def text(self) -> str:
        """The text as in a spec: `50 ms`, or `50` without a unit."""
        # enough to know the number again, and without the noise of 0.1 + 0.2
        number = f"{self.value:.12g}"
        return number if self.unit is None else f"{number} {self.unit.text}"


@dataclass(frozen=True)
class Range:
    """A lower and an upper limit, each in its own unit or without one."""

    low: Quantity
    high: Quantity
    span: Span = field(compare=False)


_HERTZ = "Hz"
_TURNS = frozenset(["rev", "rpm", "rps"])
_TIME, _ANGLE = BASE_SYMBOLS.index("s"), BASE_SYMBOLS.index("rad")


@dataclass(frozen=True)
class TurnReadings:
    """The two meanings of a conversion between a count per time and an angle per time.

    600 1/min are 600 rev/min = 62.8 rad/s (rotational frequency, ISO 80000-3), or 600 rad/min = 10
    rad/s (the radian as 1, SI brochure, section 5.4.8): they differ by 2π.
    """

    count: Unit
    """The one of the two units that names no angle."""
    in_revolutions: str
    in_radians: str

    @property
    def texts(self) -> tuple[str, str, str]:
        """Three texts: the unit that counts, and its meanings in revolutions and in radians."""
        return self.count.text, self.in_revolutions, self.in_radians


def turn_readings(unit: Unit, other: Unit) -> TurnReadings | None:
    """Both meanings, if a conversion between the units has two; else None.

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
    """A count per time with an angle: `rev/min` for `1/min`, `rad/s` for `Hz`."""
    product, second = unit_symbol(angle), unit_symbol("s")
    assert product is not None
    assert second is not None
    product = product.power(power)
    for symbol, exponent in count.factors:
        factor = second.power(-1) if symbol == _HERTZ else unit_symbol(symbol)
        assert factor is not None, "factors are symbols"
        product *= factor.power(exponent)
    return product.text


def converted(
    quantity: Quantity, unit: Unit | None, findings: Findings, *, is_distance: bool = False
) -> float | None:
    """The number of a quantity in another unit; a number without unit is already in it.

    `is_distance` ignores offsets: a difference of 10 K is one of 10 degC. If `unit` is None, the
    number is returned. None after reporting an error: another dimension, a count per time for an
    angle per time, or overflow.
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


_SECOND = "s"
_HIDDEN = {"rpm": "min", "kph": "h", "mph": "h", "kn": "h"}
"""Symbols that contain a time unit."""


def counted_time(unit: Unit) -> tuple[str, float] | None:
    """The time unit of a rate and its seconds, if it is not the second: `s/h` and 3600 for `km/h`.

    None for other units, also for `km/h/s`, which is already a rate of change per second.
    """
    found: tuple[str, float] | None = None
    for symbol, power in unit.factors:
        hidden = _HIDDEN.get(symbol, symbol)
        own = unit_symbol(hidden)
        assert own is not None, "factors are symbols"
        exponents = [(at, exponent) for at, exponent in enumerate(own.exponents) if exponent]
        # `kHz` counts per millisecond
        if len(exponents) != 1 or exponents[0][0] != _TIME:
            continue
        divides = power > 0 if hidden != symbol else power * exponents[0][1] < 0
        if not divides:
            continue
        if symbol in (_SECOND, "Hz"):
            return None
        seconds = own.scale if exponents[0][1] > 0 else 1.0 / own.scale
        if seconds != 1.0:
            text = f"s/{hidden}" if exponents[0][1] > 0 else f"s*{hidden}"
            found = found or (text, seconds)
    return found
