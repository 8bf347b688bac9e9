"""Determines the time column, its unit and the sample time."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.written_units import CapitalUnit, plain_label
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.features.data_check.errors import falling_time
from msnn.features.data_check.first_spec.columns import FoundColumn, FoundTable
from msnn.features.data_check.sampling import LONGEST_STEP
from msnn.tables import count
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.units.parser import parse_unit

_WORDS = re.compile(
    r"t|time|times|zeit|temps|tiempo|tempo|tid|seconds?|secs?|millis|clock|epoch|elapsed|uptime"
    r"|(time|zeit|epoch|elapsed|t|date)[_ ]?(stamp|time|stempel|s|ms|us|ns|sec|rel|abs)?",
    re.IGNORECASE,
)
_COUNTERS = re.compile(
    r"|#|no|nr|n|k|i|id|idx|index|row|rows|sample|samples|count|counter", re.IGNORECASE
)
_SUFFIX = re.compile(r".*[_ ](s|ms|us|ns|min|h)", re.IGNORECASE)
_SECOND = parse_unit("s")
_SCALES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
_DAY = 86400.0
_EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11))
"""Lower limits of present-day times since 1970, by unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTime:
    """The times of a file's rows."""

    column: FoundColumn | None
    """None without a time column; rows are then one sample apart."""
    unit: str
    step: float
    """Seconds between rows."""
    resample: str | None
    """Resampling method required in the spec for uneven rows."""
    notes: tuple[str, ...]
    counters: tuple[int, ...] = ()
    """Indices of columns that count rows, or contain unreadable times."""

    @property
    def scale(self) -> float:
        """Seconds per unit of the time column."""
        return _SCALES[self.unit]


def time_of(table: FoundTable, file: str) -> FoundTime:
    """The time of a file: a column with a typical name, or the first if its steps are equal.

    Raises SpecError if a column with a typical name decreases.
    """
    counters = tuple(c.index for c in table.columns if _counts(c))
    # dates before numbers: a log with both counts something else in the other one
    if table.dates is not None and _tells_time(table.dates.values):
        return _from(table.dates, counters, file)
    called = [c for c in table.columns if _WORDS.fullmatch(plain_label(c.label)[0].strip())]
    # of several that are called so the first that rises: `t` and `timestamp` may differ
    for column in called:
        if _rises(column.values):
            return _from(column, counters, file)
    if (falling := next((c for c in called if _rises(-c.values)), None)) is not None:
        raise SpecError([falling_time(file, falling.label)])
    first = table.columns[0]
    if first.index == 0 and first.index not in counters and _even(first.values):
        return _from(first, counters, file)
    note = "no column says the time: the sample time of 1 s is only a guess, write the true one"
    if table.dates is not None:
        note = (
            f"`{table.dates.label}` has days without a time of day: put both into one column, as "
            f"`2026-11-22 17:00:00.25`; {note}"
        )
    return FoundTime(
        column=None, unit="s", step=1.0, resample=None, notes=(note,), counters=counters
    )


def _from(column: FoundColumn, counters: tuple[int, ...], file: str) -> FoundTime:
    unit, why = _unit(column)
    steps = np.diff(column.values[np.isfinite(column.values)]) * _SCALES[unit]
    # the median: gaps do not move it
    usual = float(np.median(steps[steps > 0]))
    # six digits: more of them is what clocks have rounded away
    step = float(f"{usual:.6g}")
    notes = [f"time is taken as {unit}: {why}"] if why else []
    back = steps <= 0
    gaps = steps > LONGEST_STEP * step
    # where rows lie beside those that follow each other, these can stay as they are
    uneven = bool(np.any((np.abs(steps - step) > GAP_TOLERANCE * step) & ~gaps & ~back))
    place = f"`{column.label}` of {file}"
    if not np.isfinite(column.values).all():
        row = int(np.argmin(np.isfinite(column.values)))
        why = f"{place} misses a value at row {row}"
    elif back.any() and uneven:
        why = f"{_backward(place, column.values)}, and its steps are uneven: sort the rows by it"
    else:
        why = ""
    if why:
        notes.append(f"{why}; until then it is left out, and rows are taken as one sample apart")
        return FoundTime(
            column=None,
            unit=unit,
            step=step,
            resample=None,
            notes=tuple(notes),
            counters=(*counters, column.index),
        )
    # uneven rows must be brought to a grid; gaps alone may stay gaps
    resample = "linear" if uneven else "none" if gaps.any() or back.any() else None
    if back.any():
        again = "`resample: none` begins anew there; rows that were written out of order are sorted"
        notes.append(f"{_backward(place, column.values)}: {again} before")
    if uneven or gaps.any():
        what = "uneven steps" if uneven else count(int(gaps.sum()), "gap")
        notes.append(f"the time has {what}: `resample: {resample}` deals with them")
    return FoundTime(
        column=column,
        unit=unit,
        step=step,
        resample=resample,
        notes=tuple(notes),
        counters=counters,
    )


def _unit(column: FoundColumn) -> tuple[str, str]:
    """The unit of a time column, and a note if the unit was inferred."""
    # in capital letters seconds may be siemens, but not of a time
    doubt = column.doubt
    units = doubt.fitting(_SECOND) if isinstance(doubt, CapitalUnit) else (column.unit,)
    unit = units[0] if len(units) == 1 else None
    if unit is not None and unit.same_dimension(_SECOND):
        for name, scale in _SCALES.items():
            # by its size: `1e-3 s` is ms as well
            if np.isclose(unit.factor_to(_SECOND), scale):
                return name, ""
    base = plain_label(column.label)[0].strip()
    if (suffix := _SUFFIX.fullmatch(base)) is not None:
        return suffix[1].lower(), ""
    if base.lower() == "millis":
        return "ms", ""
    values = column.values[np.isfinite(column.values)]
    # from the finest down: seconds since 1970 are 1.7e9, and each finer count a thousand times that
    for name, least in _EPOCHS:
        if abs(float(values[0])) > least:
            return name, "it counts since 1970"
    usual = float(np.median(np.diff(values)))
    # seconds with digits behind the point are seconds; whole numbers far apart are counts of a
    # clock
    whole = bool(np.all(values == np.rint(values)))
    # whole minutes are more likely to be written in seconds
    if whole and usual >= 1000 and usual % 60:
        return "us", f"rows are {usual:g} apart; write `unit: s` at `time:` if they are seconds"
    if whole and usual >= 5 and usual % 60:
        return "ms", f"rows are {usual:g} apart; write `unit: s` at `time:` if they are seconds"
    return "s", "" if not whole else f"rows are {usual:g} apart"


def _backward(place: str, time: FloatArray) -> str:
    rows = np.flatnonzero(np.diff(time) <= 0) + 1
    before, then = time[rows[0] - 1], time[rows[0]]
    more = f", and in {len(rows) - 1} rows more" if len(rows) > 1 else ""
    return f"{place} does not rise at row {rows[0]} ({before:.6g}, then {then:.6g}){more}"


def _tells_time(dates: FloatArray) -> bool:
    """True if dates increase with the rows; dates without time only for rows that are days
    apart.
    """
    steps = np.diff(dates[np.isfinite(dates)])
    rises = steps > 0
    is_of_days = bool(np.all(steps % _DAY == 0))
    return bool(rises.any()) and (not is_of_days or float(np.mean(rises)) > 0.5)


def _rises(values: FloatArray) -> bool:
    """True if values increase like a clock, with a few steps back."""
    known = values[np.isfinite(values)]
    # a clock that was set back once is still one
    return len(known) > 2 and float(np.mean(np.diff(known) > 0)) > 0.9


def _even(values: FloatArray) -> bool:
    """True if values increase by a constant step."""
    steps = np.diff(values)
    if len(steps) < 2 or not np.all(steps > 0):
        return False
    usual = float(np.median(steps))
    return float(np.mean(np.abs(steps - usual) <= GAP_TOLERANCE * usual)) > 0.95


def _counts(column: FoundColumn) -> bool:
    """True if a column counts rows and has a typical name."""
    called = _COUNTERS.fullmatch(plain_label(column.label)[0].strip()) is not None
    return called and bool(np.all(np.diff(column.values) == 1))
