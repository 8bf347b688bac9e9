"""Reads units in capital letters, as devices without lower-case letters write them: `MM/S`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice, product

from spec_schema.units.parser import as_divisor, parse_unit, readings_of_capitals
from spec_schema.units.unit import Unit, UnitError, unit_symbol

MOST_REPAIRS = 3
"""Maximum number of spelling corrections per unit, such as `°` or `Nm`."""
_SYMBOL = re.compile(r"[^\W\d_¹²³⁰-⁹]+")
_POWER = re.compile(r"(?<=[^\W\d_])(?=[2-4](?!\w))")
_TURNS = re.compile(r"\b(?:U|R|TR)(?=\s*/\s*(?:MIN|S|SEC)\b)")
_MOST_READINGS = 64
_OFTEN_MEGA = frozenset(["MW", "MN", "MJ", "MΩ"])
_ACRONYMS = frozenset(["RPM", "UPM", "PSI", "MPH", "KPH", "LPM", "PPM", "HP", "BTU", "ATM"])
"""Units that are usually written in capitals, even in files with lower-case units such as
`km/h`.
"""


@dataclass(frozen=True, slots=True)
class CapitalUnit:
    """A unit in capital letters, which may be ambiguous.

    `MV` means megavolts, or millivolts from a tool that only writes capitals. The signal's declared
    unit decides, otherwise the user.
    """

    text: str
    readings: tuple[Unit, ...]
    written: Unit | None = None
    """The unit as it is written; None if that is not a unit: `MM`."""
    is_as_written: bool = False
    """True if the file has lower-case letters elsewhere, so that capitals are intended."""

    def fitting(self, declared: Unit) -> tuple[Unit, ...]:
        """The distinct readings that convert to the declared unit: exactly one if it is
        unambiguous.

        A reading equal to `declared` takes precedence, and so does the written unit if the file
        uses lower case.
        """
        found = [unit for unit in self.different if unit.converts_to(declared)]
        own = [unit for unit in found if unit.same_as(declared)]
        if self.is_as_written and self.written in found:
            # `MV` in a file with small letters, of a signal in mV: either may be a slip
            return tuple(dict.fromkeys((self.written, *own)))
        return tuple(own or found)

    @property
    def different(self) -> tuple[Unit, ...]:
        """The distinct readings; L and l, for example, are one reading."""
        found: list[Unit] = []
        for unit in self.readings:
            if not any(map(unit.same_as, found)):
                found.append(unit)
        return tuple(found)

    @property
    def likely(self) -> Unit:
        """The reading to name in messages if no reading fits."""
        return self.written or self.readings[0]


@lru_cache(1024)
def capital_unit(text: str) -> Unit | CapitalUnit | None:
    """The unit of a text in capital letters, or all units that it may mean.

    None for texts with lower-case letters, and if no reading is a unit.
    """
    if not is_capital(text):
        return None
    text = _TURNS.sub("REV", _POWER.sub("^", text))
    symbols = _SYMBOL.findall(text)
    options = [readings_of_capitals(symbol) for symbol in symbols]
    between = _SYMBOL.split(text)
    readings: list[Unit] = []
    for chosen in islice(product(*options), _MOST_READINGS):
        parts = [
            sign + (as_divisor(symbol) if sign.rstrip().endswith("/") else symbol)
            for sign, symbol in zip(between, chosen, strict=False)
        ]
        unit = repaired("".join([*parts, between[-1]]))
        if unit is not None and all(unit.text != other.text for other in readings):
            readings.append(unit)
    if not readings:
        return None
    is_exact = all(unit_symbol(symbol) is not None for symbol in symbols)
    written = repaired(text) if is_exact else None
    # a lone letter such as `M` is most often no unit: it is one where it fits the signal
    if len(readings) == 1 and (written is not None or len(text) > 1):
        return readings[0]
    return CapitalUnit(text, tuple(readings), written)


def is_capital(text: str) -> bool:
    """True if a text has letters and none of them is lower case."""
    return text.upper() == text and text.lower() != text


def keeps_case(text: str, units: Iterable[str], names: Iterable[str]) -> bool:
    """True if capitals in a unit are intended, judging by the file's other units and names.

    Units decide first: `km/h` has lower-case letters, `KM/H` lacks them. Otherwise names with
    lower-case letters decide, but only for units that are common with mega: `MW`, but not `MV`.
    """
    texts = tuple(dict.fromkeys(units))
    has_small = any(text.upper() != text for text in texts)
    lacks_small = any(is_capital(text) and _lacks_small(text) for text in texts)
    if has_small or lacks_small:
        return has_small and not lacks_small
    symbols = (symbol for symbol in _SYMBOL.findall(text) if len(symbol) > 1)
    is_usual = all(symbol in _OFTEN_MEGA for symbol in symbols if symbol.startswith("M"))
    return is_usual and any(name.upper() != name for name in names)


def _lacks_small(text: str) -> bool:
    symbols = set(_SYMBOL.findall(text)) - _ACRONYMS
    lacks = any(unit_symbol(symbol) is None for symbol in symbols)
    return lacks and capital_unit(text) is not None


def repaired(text: str) -> Unit | None:
    """The unit of a text, after corrections of unambiguous spellings; None if it is not a unit."""
    for _ in range(MOST_REPAIRS):
        try:
            return parse_unit(text) if text else None
        except UnitError as error:
            if error.meant is None:
                return None
            # parse_unit knows what was meant, for its messages: the same knowledge reads files
            text = text[: error.start] + error.meant + text[error.end :]
    return None
