"""Selects the rows of a recording by `from`, `to` and `every`, and resamples or checks gaps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from msnn.data.dataset import BETWEEN_ROWS, BoolArray, FloatArray, IntArray
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams
from msnn.data.reading.files import DataFile
from msnn.data.reading.read_file import ReadFile
from msnn.data.reading.resample import Method, Samples, lost_values, resample
from msnn.data.reading.rows import RowRange, TimeFault, continuity, picked_rows, time_bound
from msnn.errors.data import rows as data_formats
from msnn.errors.data import rows as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Date, Moment
from spec_schema.expressions.tree import Duration
from spec_schema.expressions.tree import Samples as SampleCount
from spec_schema.sections.data import Data, Layout

_HOUR = 3600.0


_HAIR = 1e-6
"""Maximum error of printed times, as a fraction of the step between rows."""


@dataclass(frozen=True, slots=True)
class LostValues:
    """Values that a column lacks although it usually has one."""

    wanting: BoolArray
    """Mask of selected rows that need one of these values."""
    rows: IntArray
    """The rows of the missing values in the file."""
    places: FloatArray
    """Positions among the selected rows: 2.5 is between the rows with indices 2 and 3."""

    def of(self, used: BoolArray) -> IntArray:
        """File rows of missing values that used rows need, or that are before the first or after
        the last.
        """
        wanting = np.flatnonzero(self.wanting & used)
        after = np.clip(np.searchsorted(self.places, wanting), 0, max(len(self.rows) - 1, 0))
        before = np.maximum(after - 1, 0)
        is_before = wanting - self.places[before] <= self.places[after] - wanting
        found = np.where(is_before & (after > before), before, after)
        # positions come from printed times: tolerate rounding at the first and last row
        last = len(used) - 1 + _HAIR
        outside = np.flatnonzero((self.places < -_HAIR) | (self.places > last))
        return self.rows[np.union1d(found, outside)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordRows:
    """Columns of the selected rows, and their continuity."""

    columns: Mapping[ColumnKey, FloatArray]
    rows: range | IntArray
    """Row in the file of each row; BETWEEN_ROWS for resampled times between two rows."""
    time: FloatArray | None
    continues: BoolArray
    """True for a row one sample after the previous row."""
    covered: BoolArray
    """False for resampled times in a hole of the data."""
    moments: Mapping[ColumnKey, IntArray] = field(default_factory=dict[ColumnKey, IntArray])
    """For each compared resampled column: the row of each measured value, or −1."""
    measured: Mapping[ColumnKey, FloatArray] = field(default_factory=dict[ColumnKey, FloatArray])
    """For each column that is only scored: the values in these rows, NaN in all others."""
    offsets: Mapping[ColumnKey, float] = field(default_factory=dict[ColumnKey, float])
    """For each of these columns: maximum seconds between a measured value and its row."""
    lost: Mapping[ColumnKey, LostValues] = field(default_factory=dict[ColumnKey, LostValues])
    """Missing values of columns that every row needs."""


def resampling(file: DataFile, data: Data) -> Method | None:
    """The method for resampling a file to the sample time; None without resampling."""
    how = file.layout.resample or data.resample
    return how if how in ("linear", "nearest") else None


def longest_gap(file: DataFile, data: Data) -> float | Duration | None:
    """The longest step that is no hole, as the spec says it for a file; None for the default."""
    return file.layout.gap or data.gap


def record_rows(
    recording: ReadFile, data: Data, sample_time: float | None, findings: Findings
) -> RecordRows | None:
    """The rows of a recording that the spec selects; None after reporting errors."""
    read, file, uses = recording.read, recording.file, recording.uses
    span = file.layout.place.key
    method = resampling(file, data)
    # without resampling, columns in `beside` are used only if they have the same times
    fitting = uses.beside if method is None else ()
    table = _one_table(read, fitting) if isinstance(read, Streams) else read
    if method is not None:
        if sample_time is None:
            findings.report(data_formats.static_resample(span))
            return None
        if table is None:
            assert isinstance(read, Streams)
            return _streams(read, recording, data, sample_time, method, findings)
        return _resampled(table, recording, data, sample_time, method, findings)
    if table is None:
        assert isinstance(read, Streams)
        first, *others = (key for key in read.columns if key not in uses.beside)
        times = read.columns[first][0]
        other = next(k for k in others if not np.array_equal(read.columns[k][0], times))
        findings.report(data_formats.different_times(file.shown, str(first), str(other), span))
        return None
    gaps_are_errors = (file.layout.resample or data.resample or "error") == "error"
    return _as_recorded(table, recording, data, sample_time, gaps_are_errors, findings)


def _one_table(streams: Streams, beside: Collection[ColumnKey]) -> ColumnTable | None:
    """The streams as one table if all have the same times; `beside` columns with other times are
    dropped.
    """
    times = {key: time for key, (time, _) in streams.columns.items()}
    first = next(time for key, time in times.items() if key not in beside)
    alike = {key for key, time in times.items() if np.array_equal(time, first)}
    if not alike >= times.keys() - set(beside):
        return None
    return ColumnTable(
        columns={key: v for key, (_, v) in streams.columns.items() if key in alike},
        time=first,
        time_begins=streams.begins,
    )


def _as_recorded(
    table: ColumnTable,
    recording: ReadFile,
    data: Data,
    sample_time: float | None,
    gaps_are_errors: bool,
    findings: Findings,
) -> RecordRows | None:
    file, time, begins = recording.file, table.time, table.time_begins
    counted = recording.counted_rows
    picked = picked_rows(file.layout, data, file.shown, table.rows, time, begins, counted, findings)
    if picked is None:
        return None
    columns = {key: column[picked.rows] for key, column in table.columns.items()}
    length = len(next(iter(columns.values())))
    continues = _unbroken(length)
    time = None if time is None else time[picked.rows]
    if time is not None and sample_time is not None:
        # of the picked rows: with `every: 2` steps are twice as long as in the file
        continues, faults = continuity(time, picked, sample_time)
        if gaps_are_errors:
            for fault in faults:
                findings.report(_time_fault(fault, recording, data, sample_time, table))
        elif (file.layout.duplicates or data.duplicates) == "error":
            same = np.flatnonzero(np.diff(time) == 0)
            if len(same):
                row = picked.first + (int(same[0]) + 1) * picked.every
                fault = TimeFault("order", row, 0.0, len(same) - 1)
                findings.report(_time_fault(fault, recording, data, sample_time, table))
    rows = range(picked.first, picked.stop, picked.every)
    lost = {key: _missing(column, picked) for key, column in columns.items()}
    return RecordRows(
        columns=columns,
        rows=rows,
        time=time,
        continues=continues,
        covered=np.ones(length, dtype=np.bool_),
        lost=lost,
    )


def _resampled(
    table: ColumnTable,
    recording: ReadFile,
    data: Data,
    sample_time: float,
    method: Method,
    findings: Findings,
) -> RecordRows | None:
    file = recording.file
    time, begins = table.time, table.time_begins
    counted = recording.counted_rows
    picked = picked_rows(file.layout, data, file.shown, table.rows, time, begins, counted, findings)
    if picked is None:
        return None
    if time is None:
        findings.report(data_formats.no_time_to_resample(file.shown, file.layout.place.key))
        return None
    moments = time[picked.rows]
    # not `diff <= 0`: of a NaN neither holds, and it is out of order too
    backward = ~(np.diff(moments) > 0)
    if backward.any():
        index = int(np.argmax(backward))
        step = float(moments[index + 1] - moments[index])
        row = picked.first + (index + 1) * picked.every
        fault = TimeFault("order", row, step, int(backward.sum()) - 1)
        findings.report(_time_fault(fault, recording, data, sample_time, table))
        return None
    columns = {key: (moments, column[picked.rows]) for key, column in table.columns.items()}
    found_rows = _on_grid(columns, picked, sample_time, method, None, recording, data)
    assert found_rows.time is not None
    return replace(found_rows, rows=_rows_at(found_rows.time, moments, picked, sample_time))


def _streams(
    streams: Streams,
    recording: ReadFile,
    data: Data,
    sample_time: float,
    method: Method,
    findings: Findings,
) -> RecordRows | None:
    file = recording.file
    span = _time_span(file, data, streams.begins, findings)
    if span is None:
        return None
    for key, (time, _) in streams.columns.items():
        if not (np.diff(time) > 0).all():
            row = int(np.argmin(np.diff(time) > 0)) + 1
            shown, step = f"`{key}` in {file.shown}", float(time[row] - time[row - 1])
            if len(recording.origins) == 1:
                _, row = recording.row_of(row, key)
            fault = errors.time_not_increasing(shown, row, step, 0, None, is_stream=True)
            findings.report(fault)
            return None
    whole = RowRange(0, 0, 1)
    rows = _on_grid(streams.columns, whole, sample_time, method, span, recording, data)
    if not len(rows.continues):
        place = file.layout.place.key
        findings.report(errors.rows_not_there(None, file.shown, 0, place))
        return None
    return rows


def _on_grid(
    columns: Mapping[ColumnKey, tuple[FloatArray, FloatArray]],
    picked: RowRange,
    sample_time: float,
    method: Method,
    span: tuple[float, float] | None,
    recording: ReadFile,
    data: Data,
) -> RecordRows:
    uses = recording.uses
    found = resample(
        columns,
        sample_time,
        method,
        span,
        beside=uses.beside,
        scored=uses.scored,
        compared=uses.compared,
        predicted=uses.counted,
        on_lines=uses.beside - uses.measured,
        gap=longest_gap(recording.file, data),
    )
    count = len(found.time)
    none = np.zeros(count, dtype=np.bool_)
    lost = {
        key: _lost(samples, picked, sample_time, found.time, found.lost.get(key, none))
        for key, samples in columns.items()
        if key not in uses.beside and key not in uses.scored
    }
    rows = np.full(count, BETWEEN_ROWS, dtype=np.int64)
    return RecordRows(
        columns=found.columns,
        rows=rows,
        time=found.time,
        continues=_unbroken(count),
        covered=found.covered,
        moments=found.moments,
        measured=found.measured,
        offsets=found.offsets,
        lost=lost,
    )


def _missing(column: FloatArray, picked: RowRange) -> LostValues:
    """The values that are missing in selected rows."""
    wanting = np.isnan(column)
    absent = np.flatnonzero(wanting)
    return LostValues(wanting, picked.first + absent * picked.every, absent.astype(np.float64))


def _lost(
    samples: Samples, picked: RowRange, sample_time: float, grid: FloatArray, wanting: BoolArray
) -> LostValues:
    """The values that a column lacks; `wanting` is the mask of grid points that need one."""
    absent = lost_values(samples, sample_time)
    places = np.full(len(absent), -1.0)  # without rows all of them are outside
    if len(grid):
        places = (samples[0][absent] - grid[0]) / sample_time
    return LostValues(wanting, picked.first + absent * picked.every, places)


def _rows_at(
    grid: FloatArray, moments: FloatArray, picked: RowRange, sample_time: float
) -> IntArray:
    """The row of the file at each grid point; BETWEEN_ROWS if none has that time."""
    after = np.clip(np.searchsorted(moments, grid), 0, len(moments) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(grid - moments[before] < moments[after] - grid, before, after)
    # the grid is summed up, the times are printed: a hair between them is none
    same = np.abs(moments[nearest] - grid) <= 1e-6 * sample_time
    return np.where(same, picked.first + nearest * picked.every, BETWEEN_ROWS)


def _time_span(
    file: DataFile, data: Data, begins: Moment | None, findings: Findings
) -> tuple[float, float] | None:
    """`from` and `to` in seconds. Reports row counts, which need a common time of all columns."""
    bounds = [-np.inf, np.inf]
    layout: Layout = file.layout
    lengths = (layout.first or data.first, layout.last or data.last)
    for index, (key, length) in enumerate(zip(("from", "to"), lengths, strict=True)):
        match length:
            case None:
                pass
            case Duration() | Date():
                bound = time_bound(f"`{key}`", length, begins, file.shown, findings)
                if bound is None:
                    return None
                bounds[index] = bound.seconds
            case SampleCount():
                findings.report(data_formats.rows_of_streams(key, file.shown, length.span))
                return None
    if (layout.every or data.every or 1) > 1:
        findings.report(data_formats.rows_of_streams("every", file.shown, layout.place.key))
        return None
    return bounds[0], bounds[1]


def _unbroken(length: int) -> BoolArray:
    continues = np.ones(length, dtype=np.bool_)
    continues[:1] = False
    return continues


def _time_fault(
    fault: TimeFault, recording: ReadFile, data: Data, sample_time: float, table: ColumnTable
) -> Diagnostic:
    place: Span | None = table.place(fault.row)
    file, row = recording.row_of(fault.row)
    match fault.kind:
        case "gap":
            return errors.time_gap(file, row, fault.step, sample_time, fault.more, place)
        case "sample time":
            time = recording.time_unit
            repair = errors.step_repair(
                fault.step,
                sample_time,
                rows=table.rows,
                every=recording.file.layout.every or data.every or 1,
                column=None if time is None else time.column,
                unit=None if time is None else time.unit,
            )
            return errors.wrong_sample_time(
                file, fault.step, sample_time, place, repair=repair if fault.is_even else None
            )
        case "order":
            begins = table.time_begins
            is_local = begins is not None and not begins.has_zone
            set_back = is_local and -_HOUR <= fault.step <= -_HOUR / 2
            return errors.time_not_increasing(
                file,
                row,
                fault.step,
                fault.more,
                place,
                set_back=set_back,
                is_stream=recording.file.keeps_time,
            )
