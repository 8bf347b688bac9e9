"""Parses dates such as `2026-11-22T17:00:00.25+01:00` (ISO 8601) exactly, in nanoseconds."""

from __future__ import annotations

import re
from dataclasses import field
from datetime import UTC, datetime, timedelta

from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

_MOMENT = re.compile(
    r"(?P<day>\d{4}-\d\d-\d\d)"
    r"(?:[Tt ]\s*(?P<clock>\d\d:\d\d)(?::(?P<second>\d\d)(?:[.,](?P<fraction>\d{1,9}))?)?"
    r"\s*(?P<zone>[Zz]|[+-](?:[01]\d|2[0-3])(?::?[0-5]\d)?)?)?"
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SECOND = timedelta(seconds=1)
FARTHEST = 2**62
"""Maximum nanoseconds from 1970: the years 1823 to 2116, whose differences fit in 64 bits."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Nanoseconds since 1970: in UTC, or in the logger's time without a time zone."""

    nanoseconds: int
    has_zone: bool

    # two moments without zone are of one clock, with zones of UTC: their difference needs no zone
    def seconds_from(self, begin: Moment) -> float:
        """The difference in seconds; both dates need a time zone, or neither."""
        assert self.has_zone == begin.has_zone
        return (self.nanoseconds - begin.nanoseconds) / 1e9

    def text_after(self, seconds: float) -> str:
        """The date so many seconds later, to the millisecond, in the format of `read_moment`."""
        milliseconds = round(self.nanoseconds / 1e6 + 1e3 * seconds)
        moment = _EPOCH + timedelta(milliseconds=milliseconds)
        parts = "milliseconds" if milliseconds % 1000 else "seconds"
        text = moment.replace(tzinfo=None).isoformat(" ", parts)
        return text + "Z" if self.has_zone else text


@dataclass(frozen=True, slots=True)
class Date:
    """`2026-03-01 08:00`: a date, which selects rows of data that have a column of dates."""

    moment: Moment
    text: str = field(compare=False)
    span: Span = field(compare=False)


def read_moment(text: str) -> Moment | None:
    """The date in a text; None for other texts, invalid days, and dates out of range."""
    found = _MOMENT.fullmatch(text)
    if found is None:
        return None
    clock = f"{found['clock'] or '00:00'}:{found['second'] or '00'}"
    try:
        # fromisoformat takes more than ISO 8601 allows, and other things from version to version:
        # the pattern decides
        whole = datetime.fromisoformat(f"{found['day']} {clock}+00:00")
    except ValueError:
        return None
    seconds = (whole - _EPOCH) // _SECOND - offset_of_zone(found["zone"] or "Z")
    # digits of a fraction count from the left: `.5` is 500 ms
    fraction = int((found["fraction"] or "").ljust(9, "0"))
    nanoseconds = seconds * 1_000_000_000 + fraction
    if abs(nanoseconds) >= FARTHEST:
        return None
    return Moment(nanoseconds, found["zone"] is not None)


def offset_of_zone(zone: str) -> int:
    """Offset of a time zone from UTC in seconds."""
    if zone in "Zz":
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return -seconds if zone[0] == "-" else seconds
