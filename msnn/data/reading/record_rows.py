"""Picks the rows of one record by `from`, `to` and `every`, resampled or checked for gaps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from msnn.data.dataset import BETWEEN_ROWS, BoolArray, FloatArray, IntArray
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams
from msnn.data.formats.written_units import StatedUnit
from msnn.data.reading.columns import file_unit, misfit
from msnn.data.reading.converted_cells import converted_cells
from msnn.data.reading.files import DataFile
from msnn.data.reading.resample import Method, Samples, lost_values, resample
from msnn.data.reading.rows import RowRange, TimeFault, continuity, picked_rows
from msnn.data.reading.time_bounds import time_bound
from msnn.errors.data import cells
from msnn.errors.data import formats as data_formats
from msnn.errors.data import rows as errors
from msnn.errors.data import units as data_units
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Date, Moment
from spec_schema.expressions.tree import Duration
from spec_schema.expressions.tree import Samples as SampleCount
from spec_schema.sections.data.data import SECOND, Data, Layout, TimeColumn
from spec_schema.units.unit import UNCHANGED, Line
from spec_schema.yaml_tree.writer import scalar_text

_HOUR = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordRows:
    """Columns of the picked rows, and how the rows follow each other."""

    columns: Mapping[ColumnKey, FloatArray]
    rows: range | IntArray
    """The file's row of each; BETWEEN_ROWS for moments that resampling put between two."""
    time: FloatArray | None
    continues: BoolArray
    """Whether a row is one sample after the row before."""
    covered: BoolArray
    """Whether a row stands on data: false for moments that resampling put into a hole."""
    begins: Moment | None = None
    """Time 0, where times are dates."""
    moments: Mapping[ColumnKey, IntArray] = field(default_factory=dict[ColumnKey, IntArray])
    """Of resampled columns that are compared: the row of each measured value, or −1."""
    measured: Mapping[ColumnKey, FloatArray] = field(default_factory=dict[ColumnKey, FloatArray])
    """Of those that are only scored: the values in these rows, NaN in all others."""
    offsets: Mapping[ColumnKey, float] = field(default_factory=dict[ColumnKey, float])
    """Of those the most seconds between a measured value and its row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnUses:
    """The columns of a file by the way in which a model uses them; it reads the others."""

    beside: frozenset[ColumnKey] = frozenset()
    """They have no say in which rows there are."""
    scored: frozenset[ColumnKey] = frozenset()
    """Predictions alone are compared with them: values between the measured ones are not needed."""
    compared: frozenset[ColumnKey] = frozenset()
    """Predictions are compared with them: a value that was not measured is not compared."""


def resampling(file: DataFile, data: Data) -> Method | None:
    """The method that brings the rows of a file to the sample time; None where none does."""
    how = file.layout.resample or data.resample
    return how if how in ("linear", "nearest") else None


def record_rows(
    read: ColumnTable | Streams,
    file: DataFile,
    data: Data,
    sample_time: float | None,
    findings: Findings,
    uses: ColumnUses,
) -> RecordRows | None:
    """The rows of a record that the spec picks; None after a report of what is wrong."""
    span = file.layout.place.key
    method = resampling(file, data)
    # resampling brings columns beside to the moments; without it only those of the same times fit
    fitting = uses.beside if method is None else ()
    column = file.layout.time or data.time
    if isinstance(read, Streams) and column is not None:
        found = _in_seconds(read, column, file.shown, findings)
        if found is None:
            return None
        read = found
    table = _one_table(read, fitting) if isinstance(read, Streams) else read
    begins = read.begins if isinstance(read, Streams) else _begins(read, column)
    if method is not None:
        if sample_time is None:
            findings.report(data_formats.static_resample(span))
            return None
        if table is None:
            assert isinstance(read, Streams)
            rows = _streams(read, file, data, sample_time, method, findings, uses)
            return None if rows is None else replace(rows, begins=begins)
        rows = _resampled(table, file, data, sample_time, method, findings, uses)
        return None if rows is None else replace(rows, begins=begins)
    if table is None:
        assert isinstance(read, Streams)
        first, *others = (key for key in read.columns if key not in uses.beside)
        times = read.columns[first][0]
        other = next(k for k in others if not np.array_equal(read.columns[k][0], times))
        findings.report(data_formats.different_times(file.shown, str(first), str(other), span))
        return None
    gaps_are_errors = (file.layout.resample or data.resample or "error") == "error"
    rows = _as_recorded(table, file, data, sample_time, gaps_are_errors, findings)
    return None if rows is None else replace(rows, begins=begins)


def _one_table(streams: Streams, beside: Collection[ColumnKey]) -> ColumnTable | None:
    """The streams as rows where all have the same times, without those beside that have others."""
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


def _begins(table: ColumnTable, column: TimeColumn | None) -> Moment | None:
    """The moment of the first row, where times are dates."""
    return None if column is None else table.begins.get(column.column.column)


def _picked(
    table: ColumnTable, file: DataFile, data: Data, findings: Findings
) -> tuple[RowRange, FloatArray | None] | None:
    """The range of rows, and the seconds of all rows of the table."""
    time = table.time
    column = file.layout.time or data.time
    if column is not None and not file.keeps_time:
        line = _to_seconds(column, table, file.shown, findings)
        if line is None:
            return None
        time = converted_cells(table.columns[column.column.column], line)
    begins = table.time_begins if file.keeps_time else _begins(table, column)
    picked = picked_rows(file.layout, data, file.shown, table.rows, time, begins, findings)
    return None if picked is None else (picked, time)


def _to_seconds(
    column: TimeColumn, table: ColumnTable, file: str, findings: Findings
) -> Line | None:
    """From the unit of the time column, of the spec or the file, else the second, to seconds."""
    key = column.column.column
    if key in table.begins:
        if column.unit is None:
            return UNCHANGED
        findings.report(
            data_units.unit_of_moments(str(key), column.unit.value.text, column.unit.span)
        )
        return None
    return _seconds_line(column, table.units.get(key), file, findings)


def _seconds_line(
    column: TimeColumn, stated: StatedUnit | None, file: str, findings: Findings
) -> Line | None:
    """From the unit of the spec, else from that which the file states, to seconds."""
    place, key = column.place.value, str(column.column.column)
    if column.unit is not None:
        unit = column.unit.value
    else:
        unit = file_unit(stated, file, "time", key, SECOND, place, findings) or SECOND
    if unit.same_dimension(SECOND):
        return unit.line_to(SECOND)
    findings.report(misfit("time", key, unit, SECOND, place))
    return None


def _in_seconds(
    streams: Streams, column: TimeColumn, file: str, findings: Findings
) -> Streams | None:
    """Streams whose times are values of the file, in seconds; None after a report."""
    columns: dict[ColumnKey, Samples] = {}
    for key, (time, values) in streams.columns.items():
        line = _seconds_line(column, streams.time_units.get(key), file, findings)
        if line is None:
            return None
        columns[key] = (converted_cells(time, line), values)
    return replace(streams, columns=columns)


def _as_recorded(
    table: ColumnTable,
    file: DataFile,
    data: Data,
    sample_time: float | None,
    gaps_are_errors: bool,
    findings: Findings,
) -> RecordRows | None:
    found = _picked(table, file, data, findings)
    if found is None:
        return None
    picked, time = found
    columns = {key: column[picked.rows] for key, column in table.columns.items()}
    length = len(next(iter(columns.values())))
    continues = _unbroken(length)
    time = None if time is None else time[picked.rows]
    if time is not None and sample_time is not None:
        # of the picked rows: with `every: 2` steps are twice as long as in the file
        continues, faults = continuity(time, picked, sample_time)
        if gaps_are_errors:
            for fault in faults:
                findings.report(_time_fault(fault, file, data, sample_time, table))
    rows = range(picked.first, picked.stop, picked.every)
    return RecordRows(
        columns=columns,
        rows=rows,
        time=time,
        continues=continues,
        covered=np.ones(length, dtype=np.bool_),
    )


def _resampled(
    table: ColumnTable,
    file: DataFile,
    data: Data,
    sample_time: float,
    method: Method,
    findings: Findings,
    uses: ColumnUses,
) -> RecordRows | None:
    found = _picked(table, file, data, findings)
    if found is None:
        return None
    picked, time = found
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
        findings.report(_time_fault(fault, file, data, sample_time, table))
        return None
    columns = {key: (moments, column[picked.rows]) for key, column in table.columns.items()}
    if data.nan == "error" and not _complete(
        columns, picked, file, sample_time, findings, uses, table
    ):
        return None
    found_rows = _on_grid(columns, sample_time, method, None, uses)
    assert found_rows.time is not None
    return replace(found_rows, rows=_rows_at(found_rows.time, moments, picked, sample_time))


def _streams(
    streams: Streams,
    file: DataFile,
    data: Data,
    sample_time: float,
    method: Method,
    findings: Findings,
    uses: ColumnUses,
) -> RecordRows | None:
    span = _time_span(file, data, streams.begins, findings)
    if span is None:
        return None
    for key, (time, _) in streams.columns.items():
        if not (np.diff(time) > 0).all():
            row = int(np.argmin(np.diff(time) > 0)) + 1
            findings.report(errors.time_not_increasing(f"`{key}` in {file.shown}", row, 0, None))
            return None
    whole = RowRange(0, 0, 1)
    if data.nan == "error" and not _complete(
        streams.columns, whole, file, sample_time, findings, uses
    ):
        return None
    rows = _on_grid(streams.columns, sample_time, method, span, uses)
    if not len(rows.continues):
        place = file.layout.place.key
        findings.report(
            errors.rows_not_there("the common time of all columns", file.shown, 0, place)
        )
        return None
    return rows


def _on_grid(
    columns: Mapping[ColumnKey, tuple[FloatArray, FloatArray]],
    sample_time: float,
    method: Method,
    span: tuple[float, float] | None,
    uses: ColumnUses,
) -> RecordRows:
    found = resample(columns, sample_time, method, span, uses.beside, uses.scored, uses.compared)
    count = len(found.time)
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
    )


def _complete(
    columns: Mapping[ColumnKey, Samples],
    picked: RowRange,
    file: DataFile,
    sample_time: float,
    findings: Findings,
    uses: ColumnUses,
    table: ColumnTable | None = None,
) -> bool:
    """Whether no input has lost a value; reports those that have."""
    is_complete = True
    for key, samples in columns.items():
        if key in uses.beside or key in uses.scored:
            continue
        absent = lost_values(samples, sample_time)
        if len(absent):
            row, more = picked.first + int(absent[0]) * picked.every, len(absent) - 1
            place = None if table is None else table.place(row)
            findings.report(cells.missing_value(file.shown, row, str(key), "", more, place))
            is_complete = False
    return is_complete


def _rows_at(
    grid: FloatArray, moments: FloatArray, picked: RowRange, sample_time: float
) -> IntArray:
    """The rows of a file at moments of a grid; BETWEEN_ROWS where it has none at that moment."""
    after = np.clip(np.searchsorted(moments, grid), 0, len(moments) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(grid - moments[before] < moments[after] - grid, before, after)
    # the grid is summed up, the times are printed: a hair between them is none
    same = np.abs(moments[nearest] - grid) <= 1e-6 * sample_time
    return np.where(same, picked.first + nearest * picked.every, BETWEEN_ROWS)


def _time_span(
    file: DataFile, data: Data, begins: Moment | None, findings: Findings
) -> tuple[float, float] | None:
    """`from` and `to` in seconds; rows cannot be counted where every column has its own."""
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
    fault: TimeFault, file: DataFile, data: Data, sample_time: float, table: ColumnTable
) -> Diagnostic:
    place: Span | None = table.place(fault.row)
    match fault.kind:
        case "gap":
            return errors.time_gap(
                file.shown, fault.row, fault.step, sample_time, fault.more, place
            )
        case "sample time":
            time = file.layout.time or data.time
            # some formats keep their time by themselves
            column = "…" if time is None else scalar_text(time.column.column, in_flow=True)
            return errors.wrong_sample_time(
                file.shown, fault.step, sample_time, column, place, is_even=fault.is_even
            )
        case "order":
            begins = _begins(table, file.layout.time or data.time)
            is_local = begins is not None and not begins.has_zone
            set_back = is_local and -_HOUR <= fault.step <= -_HOUR / 2
            return errors.time_not_increasing(
                file.shown, fault.row, fault.more, place, set_back=set_back
            )
