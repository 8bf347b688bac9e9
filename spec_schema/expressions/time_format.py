"""Reads dates in formats such as `%d/%m/%Y %H:%M:%S` (strptime), exactly to the nanosecond."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from datetime import UTC, datetime, timedelta
from functools import cache

from spec_schema.expressions.moments import FARTHEST, Moment, offset_of_zone
from spec_schema.late_dataclass import dataclass

MONTHS = (
    "January",
    "February",
    "March",
    "April",
    "May",
    "June",
    "July",
    "August",
    "September",
    "October",
    "November",
    "December",
)
DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")


def _names(names: tuple[str, ...], length: int | None) -> str:
    return "|".join(name[:length] for name in names)


_DIRECTIVES: Mapping[str, str] = {
    "Y": r"\d{4}",
    "y": r"\d{2}",
    "m": r"\d{1,2}",
    "d": r"\d{1,2}",
    "j": r"\d{1,3}",
    "H": r"\d{1,2}",
    "I": r"\d{1,2}",
    "M": r"\d{1,2}",
    "S": r"\d{1,2}",
    "f": r"\d{1,9}",
    "p": r"AM|PM",
    "b": _names(MONTHS, 3),
    "B": _names(MONTHS, None),
    "a": _names(DAYS, 3),
    "A": _names(DAYS, None),
    "z": r"[Zz]|[+-](?:[01]\d|2[0-3])(?::?[0-5]\d)?",
}
"""The pattern of each directive. Names of months and days are English in every locale."""
_INSTEAD: Mapping[str, str] = {
    "T": "%H:%M:%S",
    "R": "%H:%M",
    "F": "%Y-%m-%d",
    "D": "%m/%d/%y",
    "e": "%d",
    "k": "%H",
    "l": "%I",
    "h": "%b",
    "L": "%f",
    "N": "%f",
    "P": "%p",
}
"""Directives of other libraries, and the directives that mean the same."""
_NEEDS: Mapping[str, str] = {"f": "S", "S": "M", "M": "H"}
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SECOND = timedelta(seconds=1)


@dataclass(frozen=True, slots=True)
class FormatFault:
    """A mistake in a format: the part `text[first:last]`, the reason and the repair."""

    first: int
    last: int
    reason: str
    repair: str | None = None


@dataclass(frozen=True, slots=True)
class TimeFormat:
    """A format without mistakes. `%d`, `%m`, `%H`, … take one digit or two, `%f` one to nine."""

    text: str
    pattern: re.Pattern[str] = field(compare=False, repr=False)

    @property
    def has_zone(self) -> bool:
        """True if each cell states its offset from UTC."""
        return "z" in self.pattern.groupindex

    def moment(self, cell: str) -> Moment | None:
        """The date in a cell; None if it does not fit, is no date, or is too far from 1970."""
        found = self.pattern.fullmatch(cell)
        if found is None:
            return None
        parts = found.groupdict()
        try:
            day = _day(parts)
            hour = int(parts.get("H") or parts.get("I") or 0)
            if "I" in parts:
                if not 1 <= hour <= 12:
                    return None
                hour = hour % 12 + (12 if parts["p"].upper() == "PM" else 0)
            minute, second = int(parts.get("M") or 0), int(parts.get("S") or 0)
            whole = day.replace(hour=hour, minute=minute, second=second)
        except ValueError:
            return None
        named = parts.get("a") or parts.get("A")
        if named is not None and DAYS[whole.weekday()][:3].lower() != named[:3].lower():
            return None
        zone = parts.get("z")
        seconds = (whole - _EPOCH) // _SECOND - offset_of_zone(zone or "Z")
        # digits of a fraction count from the left: `.5` is 500 ms
        nanoseconds = seconds * 1_000_000_000 + int((parts.get("f") or "").ljust(9, "0"))
        return None if abs(nanoseconds) >= FARTHEST else Moment(nanoseconds, zone is not None)


def _day(parts: Mapping[str, str]) -> datetime:
    """Midnight of the day. ValueError if there is no such day."""
    if "Y" in parts:
        year = int(parts["Y"])
    else:
        # as POSIX has it: 69 is 1969, 68 is 2068
        year = int(parts["y"]) + (1900 if int(parts["y"]) >= 69 else 2000)
    if "j" in parts:
        day = datetime(year, 1, 1, tzinfo=UTC) + timedelta(days=int(parts["j"]) - 1)
        if day.year != year:
            raise ValueError(parts["j"])
        return day
    named = parts.get("b") or parts.get("B")
    if named is None:
        month = int(parts["m"])
    else:
        month = [name[:3].lower() for name in MONTHS].index(named[:3].lower()) + 1
    return datetime(year, month, int(parts["d"]), tzinfo=UTC)


@cache
def time_format(text: str) -> TimeFormat | FormatFault:
    """The format in a text, or its first mistake."""
    pieces = list(_pieces(text))
    seen: dict[str, tuple[int, int]] = {}
    parts: list[str] = []
    for index, (first, last, piece) in enumerate(pieces):
        if piece == "%%":
            parts.append("%")
        elif not piece.startswith("%"):
            # cells come without blanks at their ends
            is_inside = first > 0 and last < len(text)
            blanks = r"\s+" if is_inside else r"\s*"
            parts.append(blanks if piece.isspace() else re.escape(piece))
        else:
            name = piece[1:]
            if (fault := _fault_of(name, first, last)) is not None:
                return fault
            if name in seen:
                return FormatFault(first, last, f"`{piece}` is there twice", "write it once")
            seen[name] = first, last
            # without a separator only the number of digits tells where a number ends
            beside = (pieces[max(index - 1, 0) : index], pieces[index + 1 : index + 2])
            is_fixed = any(_is_digits(other) for near in beside for _, _, other in near)
            own = _DIRECTIVES[name]
            if is_fixed and name != "f":
                own = own.replace("{1,", "{")
            parts.append(f"(?P<{name}>{own})")
    return _misfit(seen, len(text)) or TimeFormat(text, re.compile("".join(parts), re.I | re.A))


def _is_digits(piece: str) -> bool:
    """True for a digit, and for a directive whose cell begins and ends with digits."""
    return piece.isdigit() or (piece[0] == "%" and piece[1:] in tuple("YymdjHIMSf"))


def written_format(text: str) -> TimeFormat:
    """The format in a text that has no mistakes."""
    found = time_format(text)
    assert isinstance(found, TimeFormat), "checked where the spec is read"
    return found


def _pieces(text: str) -> Iterator[tuple[int, int, str]]:
    """The directives, blanks and other characters with their places."""
    for found in re.finditer(r"%.?|\s+|[^%\s]", text, re.S):
        yield found.start(), found.end(), found.group()


def _fault_of(name: str, first: int, last: int) -> FormatFault | None:
    if name in _DIRECTIVES and name:
        return None
    directive = f"`%{name}`"
    if name in _INSTEAD:
        return FormatFault(first, last, f"{directive} is no directive", f"write `{_INSTEAD[name]}`")
    if name == "Z":
        repair = "write its letters as they are, and the zone as `zone: Europe/Berlin`"
        return FormatFault(first, last, "`%Z`, the name of a zone, is not read", repair)
    if name == "s":
        repair = "seconds since 1970 are numbers: leave `format:` out"
        return FormatFault(first, last, "`%s` is no directive", repair)
    if not name:
        return FormatFault(first, last, "`%` is not followed by a letter", "write `%%` for a `%`")
    known = " ".join(f"%{key}" for key in _DIRECTIVES)
    return FormatFault(first, last, f"{directive} is no directive", f"directives are {known}")


def _misfit(seen: Mapping[str, tuple[int, int]], length: int) -> FormatFault | None:
    """The reason why directives do not make a date and a time of day."""
    for one, other in (("Y", "y"), ("m", "b"), ("m", "B"), ("b", "B"), ("a", "A"), ("H", "I")):
        if one in seen and other in seen:
            reason = f"`%{one}` and `%{other}` say the same"
            return FormatFault(*seen[other], reason, "write one of them")
    has_day = "j" in seen or ("d" in seen and seen.keys() & {"m", "b", "B"})
    if not seen.keys() & {"Y", "y"} or not has_day:
        repair = "a date is `%Y-%m-%d`, `%d/%m/%Y` or `%d %b %y`, for example"
        return FormatFault(0, length, "it has no complete date", repair)
    if "j" in seen and (both := seen.keys() & {"d", "m", "b", "B"}):
        name = min(both)
        return FormatFault(*seen[name], f"`%j` and `%{name}` say the same", "write one of them")
    for name, needed in _NEEDS.items():
        if name in seen and needed not in seen and not (needed == "H" and "I" in seen):
            reason = f"`%{name}` needs `%{needed}`"
            return FormatFault(*seen[name], reason, f"write `%{needed}` too")
    if ("I" in seen) != ("p" in seen):
        reason = "`%I`, the hours from 1 to 12, needs `%p`, and only `%I` does"
        place = seen.get("I") or seen["p"]
        return FormatFault(*place, reason, "write `%H`, or `%I` and `%p`")
    return None
