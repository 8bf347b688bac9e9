"""Converts times and dates of a spec to seconds on a recording's clock."""

from __future__ import annotations

from dataclasses import dataclass

from msnn.errors.data import units as data_units
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.moments import Date, Moment
from spec_schema.expressions.tree import Duration


@dataclass(frozen=True, slots=True)
class TimeBound:
    """A time in seconds, and the tolerance within which a row is at that time."""

    seconds: float
    slack: float


def bound_of_seconds(seconds: float) -> TimeBound:
    """The bound at a time, tolerant to rounding: 59.99999 and 60 mean the same row."""
    return TimeBound(seconds, 1e-6 * max(abs(seconds), 1.0))


def time_bound(
    what: str, wanted: Duration | Date, begins: Moment | None, file: str, findings: Findings
) -> TimeBound | None:
    """The bound in a recording whose time 0 is `begins`; None if its times are not dates.

    Returns None after reporting a date that cannot be compared with the recording's times.
    """
    match wanted:
        case Duration():
            return bound_of_seconds(wanted.seconds)
        case Date():
            # a date with a zone and one without cannot be compared: nobody knows the logger's zone
            if begins is None or begins.has_zone != wanted.moment.has_zone:
                zone = None if begins is None else begins.has_zone
                findings.report(
                    data_units.misfitting_date(what, wanted.text, file, zone, wanted.span)
                )
                return None
            # dates are exact; in float64, seconds of three years are rounded to 15 ns
            return TimeBound(wanted.moment.seconds_from(begins), 1e-7)
