"""Reads moments such as `2026-11-22T17:00:00.25+01:00` (ISO 8601) exactly, in nanoseconds."""

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
"""Nanoseconds from 1970: 1823 to 2116, whose differences 64 bits hold."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Nanoseconds since 1970: of UTC, or of the logger's own clock where no zone is given."""

    nanoseconds: int
    has_zone: bool

    # two moments without zone are of one clock, with zones of UTC: their difference needs no zone
    def seconds_from(self, begin: Moment) -> float:
        """The seconds that lie between; the clocks of both must be known, or of none."""
        assert self.has_zone == begin.has_zone
        return (self.nanoseconds - begin.nanoseconds) / 1e9

    def text_after(self, seconds: float) -> str:
        """The moment so many seconds later, to the millisecond, as `read_moment` reads it."""
        milliseconds = round(self.nanoseconds / 1e6 + 1e3 * seconds)
        moment = _EPOCH + timedelta(milliseconds=milliseconds)
        parts = "milliseconds" if milliseconds % 1000 else "seconds"
        text = moment.replace(tzinfo=None).isoformat(" ", parts)
        return text + "Z" if self.has_zone else text


@dataclass(frozen=True, slots=True)
class Date:
    """`2026-03-01 08:00`: a moment to be looked for in times that are dates."""

    moment: Moment
    text: str = field(compare=False)
    span: Span = field(compare=False)


def read_moment(text: str) -> Moment | None:
    """The moment that a text means; None for other texts and days that are none or too far away."""
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
    seconds = (whole - _EPOCH) // _SECOND - _offset(found["zone"] or "Z")
    # digits of a fraction count from the left: `.5` is 500 ms
    fraction = int((found["fraction"] or "").ljust(9, "0"))
    nanoseconds = seconds * 1_000_000_000 + fraction
    if abs(nanoseconds) >= FARTHEST:
        return None
    return Moment(nanoseconds, found["zone"] is not None)


def _offset(zone: str) -> int:
    """Seconds by which a zone is ahead of UTC."""
    if zone in "Zz":
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return -seconds if zone[0] == "-" else seconds
