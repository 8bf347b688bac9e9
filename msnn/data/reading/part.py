"""Selects the rows of a recording, as series of signals with their gaps and missing inputs."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from compiler.ir.program import Program, Role
from msnn.data.dataset import BoolArray, FileRows, FloatArray, IntArray
from msnn.data.formats.table import ColumnKey, ColumnTable
from msnn.data.reading.columns import Feed
from msnn.data.reading.files import DataFile
from msnn.data.reading.read_file import ReadFile
from msnn.data.reading.record_rows import RecordRows, record_rows, resampling
from msnn.data.reading.resample import LOST_STEP, lost_values
from msnn.data.reading.row_filter import RowFilter
from msnn.errors.data import cells
from msnn.errors.data import rows as data_formats
from msnn.errors.data.rows import rows_not_there
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.moments import Moment
from spec_schema.sections.data import Data

_FEWEST_VALUES = 4
"""Minimum number of values from which the usual step of a column is determined."""
_HAIR = 1e-9
"""Maximum difference in seconds between summed and printed times of the same row."""


@dataclass(frozen=True, slots=True)
class KeptValues:
    """Counts of a column's measured values before and after resampling."""

    measured: int
    kept: int
    """Rows with a measured value."""
    lost: int
    """Values without a row, or only with a row at which an input is missing."""
    rows: int
    """All rows, with and without a measured value."""
    offset: float = 0.0
    """Maximum seconds between a value and its row, among values that are not interpolated."""

    def __add__(self, other: KeptValues) -> KeptValues:
        return KeptValues(
            self.measured + other.measured,
            self.kept + other.kept,
            self.lost + other.lost,
            self.rows + other.rows,
            max(self.offset, other.offset),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FilePart:
    """The selected rows of one file, or of several consecutive files."""

    file: DataFile
    pieces: tuple[FileRows, ...]
    series: dict[str, FloatArray]
    time: FloatArray | None
    """Time of each row in seconds, if the file has a time."""
    continues: BoolArray
    usable: BoolArray
    begins: Moment | None = None
    """The date of time 0, if the file has one."""
    kept: Mapping[ColumnKey, KeptValues] = field(default_factory=dict[ColumnKey, KeptValues])
    """Counts for resampled columns that predictions are compared with."""
    measured: Mapping[str, BoolArray] = field(default_factory=dict[str, BoolArray])
    """For resampled signals that are both read and compared: mask of rows with a measured value."""
    missing: tuple[str, int] | None = None
    """The file and row of the first missing input in a used row."""


def part_of(
    recording: ReadFile,
    program: Program,
    data: Data,
    row_filter: RowFilter | None,
    findings: Findings,
) -> FilePart | None:
    """The rows of a recording that the spec selects; None after reporting errors."""
    rows = record_rows(recording, data, program.sample_time, findings)
    if rows is None:
        return None
    found, uses = recording.found, recording.uses
    series = {feed.signal.name: feed.series(rows.columns) for feed in found}
    # rows in a hole were not measured, rows without an input cannot be simulated: both end an
    # episode
    usable = rows.covered.copy()
    in_hole = ~rows.covered
    for lost in rows.lost.values():
        in_hole &= ~lost.wanting
    for feed in found:
        values = series[feed.signal.name].reshape(len(usable), len(feed.keys))
        values[in_hole] = np.nan  # what resampling drew through a hole was not measured
        for element, key in enumerate(feed.keys):
            if key in rows.lost:
                values[rows.lost[key].wanting, element] = np.nan
    needed = _needed(program, found, rows)
    for feed in needed:
        values = series[feed.signal.name].reshape(len(usable), len(feed.keys))
        usable &= np.isfinite(values).all(axis=1)
    single = uses.measured & rows.measured.keys()
    offsets = {key: rows.offsets[key] for key in single}
    kept = {
        key: _kept_values(moments, usable, offsets.get(key, 0.0))
        for key, moments in rows.moments.items()
        # of a signal that the model reads, rows that were not measured are worth a word
        if key in single or (key in uses.counted and not _marked(key, rows)[usable].all())
    }
    left_out = np.zeros(len(usable), np.bool_)
    if row_filter is not None:
        passes = _kept(row_filter, series, rows, recording.file, findings)
        # a missing value may be one of a row that the filter would keep
        left_out = ~passes & _is_known(row_filter, series, len(usable))
        usable &= passes
    missing = _first_missing(recording, needed, rows, left_out, data, program.sample_time, findings)
    if not len(usable) and (missing is None or data.nan == "split"):
        # columns of which one ends before another begins
        place = recording.file.layout.place.key
        findings.report(rows_not_there(None, recording.file.shown, recording.rows, place))
    for values in series.values():
        values[~rows.covered] = np.nan
    # after the filter, which may read between measured values
    columns = {**rows.columns, **{key: _at_moments(key, rows) for key in single}}
    series |= {feed.signal.name: feed.series(columns) for feed in found if single & set(feed.keys)}
    # of an input that the model reads, values between those measured are there, not scored
    measured = {
        feed.signal.name: np.all([_marked(key, rows) for key in read], axis=0)
        for feed in found
        if (read := set(feed.keys) & uses.compared & rows.moments.keys() - single)
    }
    # what only the filter read is not kept
    series = {signal.name: series[signal.name] for signal in program.signals}
    series |= {
        feed.signal.name: feed.series_if_there(rows.columns, len(usable)) for feed in recording.more
    }
    return FilePart(
        file=recording.file,
        pieces=_pieces(recording, rows),
        series=series,
        time=rows.time,
        continues=rows.continues,
        usable=usable,
        begins=recording.begins,
        kept=kept,
        measured=measured,
        missing=missing,
    )


def _needed(program: Program, found: Sequence[Feed], rows: RecordRows) -> list[Feed]:
    """The inputs of the program, without those that are only compared with predictions."""
    return [
        feed
        for feed in found
        if feed.signal.role is Role.INPUT
        and feed.signal in program.signals
        and not rows.measured.keys() >= set(feed.keys)
    ]


def _is_known(row_filter: RowFilter, series: Mapping[str, FloatArray], rows: int) -> BoolArray:
    """The rows in which all values read by a filter are present."""
    known = np.ones(rows, np.bool_)
    for name in row_filter.read:
        values = series[name]
        known &= np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    return known


def _first_missing(
    recording: ReadFile,
    needed: Sequence[Feed],
    rows: RecordRows,
    left_out: BoolArray,
    data: Data,
    sample_time: float | None,
    findings: Findings,
) -> tuple[str, int] | None:
    """File and row of the first missing input in a used row; None if no input is missing.

    Reports each column with missing inputs if the spec makes them an error.
    """
    first: tuple[int, ColumnKey] | None = None
    for key in dict.fromkeys(key for feed in needed for key in feed.keys):
        lost = rows.lost.get(key)
        if lost is None or not len(lost.rows):
            continue
        used = lost.of(~left_out)
        if not len(used):
            continue
        row = int(used[0])
        first = (row, key) if first is None or row < first[0] else first
        if data.nan == "error":
            text, place = "", None
            if isinstance(recording.read, ColumnTable):
                text, place = recording.read.cell(row, key)
                values = recording.read.columns[key]
            else:
                _, values = recording.read.columns[key]
            file, own = recording.row_of(row, key)
            more, is_all = len(used) - 1, bool(np.isnan(values).all())
            findings.report(
                cells.missing_value(
                    file,
                    own,
                    str(key),
                    text,
                    more,
                    place,
                    is_all=is_all,
                    is_slow=_is_slow(recording, data, values, sample_time),
                )
            )
    return None if first is None else recording.row_of(*first)


def _is_slow(
    recording: ReadFile, data: Data, values: FloatArray, sample_time: float | None
) -> bool:
    """True for a column that is sampled more slowly than the rows and has no `resample:`."""
    if sample_time is None or not isinstance(recording.read, ColumnTable):
        return False
    time = recording.read.time
    if time is None or resampling(recording.file, data) is not None:
        return False
    if np.isfinite(values).sum() < _FEWEST_VALUES or not (np.diff(time) > 0).all():
        return False
    # a few values that are lost, of a column as fast as the rows, are no slow column
    own = float(np.median(np.diff(time[np.isfinite(values)])))
    is_slower = own > LOST_STEP * float(np.median(np.diff(time)))
    return is_slower and not len(lost_values((time, values), sample_time))


def _pieces(recording: ReadFile, rows: RecordRows) -> tuple[FileRows, ...]:
    """The rows of each file of a recording."""
    count, origins = len(rows.continues), recording.origins
    if isinstance(rows.rows, range):
        starts = [bisect_left(rows.rows, origin.row) for origin in origins]
    else:
        assert rows.time is not None, "rows between those of a file have a time"
        # the grid is a cumulative sum: rounding may put a row slightly before its file
        starts = [int(np.searchsorted(rows.time, origin.begins - _HAIR)) for origin in origins]
    starts[0] = 0
    found: list[FileRows] = []
    for origin, start, stop in zip(origins, starts, [*starts[1:], count], strict=True):
        own = rows.rows[start:stop]
        if isinstance(own, range) and not origin.remaining:
            own = range(own.start - origin.row, own.stop - origin.row, own.step)
        else:
            own = origin.file_rows(np.asarray(own, np.int64))
        time = None if rows.time is None else rows.time[start:stop] - origin.seconds
        if stop > start or len(origins) == 1:
            found.append(
                FileRows(
                    file=origin.file,
                    start=start,
                    stop=stop,
                    rows=own,
                    time=time,
                    time_begins=origin.seconds,
                    time_unit=recording.time_unit,
                )
            )
    return tuple(found)


def _kept_values(moments: IntArray, usable: BoolArray, offset: float) -> KeptValues:
    there = moments[moments >= 0]
    there = there[usable[there]]
    lost = len(moments) - len(there)
    return KeptValues(len(moments), len(np.unique(there)), lost, len(usable), offset)


def _at_moments(key: ColumnKey, rows: RecordRows) -> FloatArray:
    """The measured values of a resampled column in their rows; NaN elsewhere and in holes."""
    return np.where(rows.covered, rows.measured[key], np.nan)


def _marked(key: ColumnKey, rows: RecordRows) -> BoolArray:
    """Mask of the rows to which a measured value of a resampled column belongs."""
    marked = np.zeros(len(rows.continues), dtype=np.bool_)
    marked[rows.moments[key][rows.moments[key] >= 0]] = True
    return marked


def _kept(
    row_filter: RowFilter,
    series: dict[str, FloatArray],
    rows: RecordRows,
    file: DataFile,
    findings: Findings,
) -> BoolArray:
    kept = row_filter.kept(series, len(rows.continues))
    if len(kept) and not kept.any():
        findings.report(data_formats.empty_filter(file.shown, row_filter.span))
    return kept
