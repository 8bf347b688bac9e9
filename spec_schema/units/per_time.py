"""Finds the time unit of a rate if it is not the second: the hour in `L/h` and `kph`."""

from spec_schema.units.table import BASE_SYMBOLS
from spec_schema.units.unit import Unit, unit_symbol

_SECOND = "s"
_TIME = BASE_SYMBOLS.index(_SECOND)
_HIDDEN = {"rpm": "min", "kph": "h", "mph": "h", "kn": "h"}
"""Symbols that contain a time unit."""


def counted_time(unit: Unit) -> tuple[str, float] | None:
    """`s/h` and 3600 of a unit that is divided by a time other than the second; None of others.

    `km/h/s` is a rate of change per second already: of it nothing is said.
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
