"""Reads the columns of a file that the signals need, and the time of each row in seconds."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from compiler.ir.program import Program, Role, Signal
from msnn.data.dataset import BETWEEN_ROWS, FloatArray, IntArray, TimeUnit
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams, TimeSource, WantedColumns
from msnn.data.formats.table_of_formats import unread_suffix
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.text.text_encoding import other_name, refuse_other_formats
from msnn.data.formats.written_units import CapitalUnit, StatedUnit, is_number
from msnn.data.reading.columns import (
    Feed,
    columns_of_only,
    converted_cells,
    feeds,
    file_unit,
    in_units_of_file,
    misfit,
    report_scaled_twice,
    wanted_columns,
)
from msnn.data.reading.duplicates import RemainingRows, without_duplicates
from msnn.data.reading.files import DataFile, unused_without_times
from msnn.data.reading.local_times import fixed_zone, utc_times
from msnn.data.reading.row_filter import RowFilter
from msnn.data.rollout_rows import compared_signals, measured_beside, signals_only_compared
from msnn.errors.data import cells as data_units
from msnn.errors.data.files import no_column_read, no_reader, read_as_text
from msnn.errors.data.rows import unused_key
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.expressions.moments import Moment
from spec_schema.fields.leaf import Located
from spec_schema.sections.data import SECOND, Csv, Data, TimeColumn
from spec_schema.units.unit import UNCHANGED, Line, Unit
from spec_schema.yaml_tree.writer import scalar_text


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnUses:
    """The columns of a file by their use; all other columns are inputs of the model."""

    beside: frozenset[ColumnKey] = frozenset()
    """Columns that do not determine which rows exist."""
    scored: frozenset[ColumnKey] = frozenset()
    """Columns compared with predictions, in which a missing value does not end an episode."""
    measured: frozenset[ColumnKey] = frozenset()
    """Columns whose interpolated values are never needed."""
    compared: frozenset[ColumnKey] = frozenset()
    """Columns compared with predictions; interpolated values are excluded from the comparison."""
    counted: frozenset[ColumnKey] = frozenset()
    """Columns that are compared with predictions of the program."""


@dataclass(frozen=True, slots=True)
class FileOrigin:
    """A file of a recording, and its position in the recording."""

    file: str
    row: int
    """The row of the recording that is row 0 of the file."""
    begins: float
    """Time of the file's first row in the recording, in seconds."""
    seconds: float
    """The file's time 0 in the recording, in seconds."""
    remaining: Mapping[ColumnKey, RemainingRows] = field(
        default_factory=dict[ColumnKey, RemainingRows]
    )
    """The rows without duplicates, for each column; empty if the file has none."""

    def file_rows(self, rows: IntArray, key: ColumnKey | None = None) -> IntArray:
        """The rows of the file, of rows of the recording that are from this file.

        `key` names the column if columns have times of their own.
        """
        own = np.where(rows == BETWEEN_ROWS, rows, rows - self.row)
        if not self.remaining:
            return own
        # without a key: all columns have the same times, or rows mean little
        key = next(iter(self.remaining)) if key is None else key
        return np.where(rows == BETWEEN_ROWS, rows, self.remaining[key].rows[own])


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadFile:
    """All rows of a file, or of several consecutive files, for the signals that they feed."""

    file: DataFile
    read: ColumnTable | Streams
    """The columns; times are in seconds."""
    found: Sequence[Feed]
    """Feeds of the signals of the program and of the filter."""
    more: Sequence[Feed]
    """Feeds of signals that the file may lack."""
    uses: ColumnUses
    origins: tuple[FileOrigin, ...]
    time_unit: TimeUnit | None = None

    def as_recorded(self) -> ReadFile:
        """The same file without resampling; gaps and repeated times are not errors."""
        # `first` changes nothing here: it was applied when the file was read
        layout = self.file.layout.model_copy(update={"resample": "none", "duplicates": "first"})
        return replace(self, file=replace(self.file, layout=layout))

    @property
    def rows(self) -> int:
        """The number of rows; for streams, the number of values of the first column."""
        if isinstance(self.read, ColumnTable):
            return self.read.rows
        return len(next(iter(self.read.columns.values()))[0])

    def row_of(self, row: int, key: ColumnKey | None = None) -> tuple[str, int]:
        """The file that a row of the recording comes from, and its row in that file.

        `key` names the column if columns have times of their own.
        """
        origin = next(origin for origin in reversed(self.origins) if origin.row <= row)
        return origin.file, int(origin.file_rows(np.array([row]), key)[0])

    @property
    def counted_rows(self) -> IntArray | None:
        """The number of each row, from 0, where duplicates count too; None if there are none."""
        if not any(origin.remaining for origin in self.origins):
            return None
        stops = [*(origin.row for origin in self.origins[1:]), self.rows]
        numbers: list[IntArray] = []
        begin = 0
        for origin, stop in zip(self.origins, stops, strict=True):
            numbers.append(begin + origin.file_rows(np.arange(origin.row, stop)))
            remaining = next(iter(origin.remaining.values()), None)
            begin += stop - origin.row if remaining is None else remaining.count
        return np.concatenate(numbers)

    @property
    def begins(self) -> Moment | None:
        """Time 0, if times are dates."""
        return self.read.begins if isinstance(self.read, Streams) else self.read.time_begins

    @property
    def times(self) -> Mapping[ColumnKey, FloatArray] | None:
        """The times in seconds of each column that determines which rows exist."""
        if isinstance(self.read, Streams):
            return {k: t for k, (t, _) in self.read.columns.items() if k not in self.uses.beside}
        time = self.read.time
        return None if time is None else {0: time}


def read_file(
    program: Program,
    data: Data,
    file: DataFile,
    row_filter: RowFilter | None,
    findings: Findings,
    whole: Program | None = None,
) -> ReadFile | None:
    """The columns of a file; None after reporting errors.

    The file may lack signals that the model `whole` predicts and the program does not read.
    """
    # of its own: `failed` is then about this file alone
    mine = Findings()
    columns = {**data.columns, **file.layout.columns}
    found = feeds(_signals(program, row_filter), columns, mine)
    beside = () if whole is None else measured_beside(whole, program)
    more = feeds(beside, columns, mine)
    column = file.layout.time or data.time
    if column is not None and file.keeps_time:
        for name, key in (("format", column.format), ("zone", column.zone)):
            if key is not None:
                reason = f"the times of {file.shown} are no texts of dates"
                mine.report(unused_key(f"time: {{{name}}}", reason, key.span))
    read = _columns(file, data, column, found, more, mine)
    if read is not None:
        read = _without_marked(read, _marks(file, data, (*found, *more)))
        mine.report(*read.warnings)
        if file.keeps_time and isinstance(read, ColumnTable) and read.time is None:
            mine.report(*unused_without_times(file, data))
        found = in_units_of_file(found, read.units, file.shown, mine)
        more = in_units_of_file(more, read.units, file.shown, mine)
    if read is not None:
        report_scaled_twice((*found, *more), read.packed, mine)
    if isinstance(read, ColumnTable) and not read.columns and not mine.failed:
        mine.report(no_column_read(file.shown, program.name))
    if read is not None and not mine.failed:
        read = _in_seconds(read, file, column, mine)
    remaining: Mapping[ColumnKey, RemainingRows] = {}
    if read is not None and not mine.failed:
        read, remaining = without_duplicates(read, file.layout.duplicates or data.duplicates)
    findings.report(*mine.in_order)
    if read is None or mine.failed:
        return None
    return ReadFile(
        file=file,
        read=read,
        found=found,
        more=more,
        uses=_uses(program, found, more, whole or program),
        origins=(FileOrigin(file.shown, 0, 0.0, 0.0, remaining),),
        time_unit=_time_unit(read, column),
    )


def _signals(program: Program, row_filter: RowFilter | None) -> tuple[Signal, ...]:
    """The signals of the program and additional ones that the filter reads."""
    known = {signal.name for signal in program.signals}
    more = () if row_filter is None else row_filter.signals
    return (*program.signals, *(signal for signal in more if signal.name not in known))


def _uses(
    program: Program, found: Sequence[Feed], more: Sequence[Feed], whole: Program
) -> ColumnUses:
    compared, lone = compared_signals(program), signals_only_compared(program)
    # a part of a model has the same targets as the complete model
    as_measured = signals_only_compared(whole)
    # a column that a signal of the program needs as well may not be missing
    spare = wanted_columns(more).keys() - wanted_columns(found).keys()
    targets = {feed.signal.name for feed in found if feed.signal.role is Role.TARGET}
    # `validate` may compare with any of them
    keys = frozenset(wanted_columns(found))
    return ColumnUses(
        beside=frozenset(spare),
        scored=columns_of_only(found, targets | lone),
        measured=columns_of_only([*found, *more], as_measured),
        compared=keys,
        counted=frozenset(k for f in found if f.signal.name in compared for k in f.keys),
    )


def _columns(
    file: DataFile,
    data: Data,
    time: TimeColumn | None,
    found: Sequence[Feed],
    more: Sequence[Feed],
    findings: Findings,
) -> ColumnTable | Streams | None:
    needed = wanted_columns(found)
    users = {**wanted_columns(more), **needed}
    # a column that both need is needed
    spare = frozenset(users) - frozenset(needed)
    # rows are picked before anybody asks which of their values are missing
    optional = frozenset(users)
    moments = frozenset[ColumnKey]()
    if time is not None and not file.keeps_time:
        moments = frozenset({time.column.column})
        users[time.column.column] = "`time`"
        # without time nobody knows how rows follow each other, whatever `nan:` says of values
        optional -= {time.column.column}
        spare -= {time.column.column}
    try:
        marks = _marks(file, data, (*found, *more))
        texts = {
            key: frozenset(mark.lower() for mark in own if isinstance(mark, str))
            for key, own in marks.items()
        }
        source = _time_source(file, time)
        written = None if time is None or time.format is None else time.format.value
        wanted = WantedColumns(users, optional, spare, moments, texts, written, source)
        if file.arrays is not None:
            return file.arrays.table(wanted)
        dialect = _dialect(file.layout.csv or data.csv, tabs=file.path.suffix.lower() == ".tsv")
        read = file.format.reader(file.path, file.shown, wanted, dialect)
    except SpecError as error:
        faults = [_with_name(fault, file) for fault in error.diagnostics]
        if file.arrays is None:
            faults = taken_as_text(file.path, file.shown, faults)
        findings.report(*faults)
        return None
    if (suffix := unread_suffix(file.path)) is not None:
        findings.report(read_as_text(suffix))
    return read


def taken_as_text(path: Path, shown: str, faults: Sequence[Diagnostic]) -> Sequence[Diagnostic]:
    """The faults of a file; the first one says if the file was only taken as text (E0932)."""
    suffix = unread_suffix(path)
    # a file that cannot be opened may have any format, and a known one has a repair of its own
    if suffix is None or not faults or not os.access(path, os.R_OK) or _is_identified(path):
        return faults
    return (no_reader(suffix, shown, faults[0]), *faults[1:])


def _is_identified(path: Path) -> bool:
    """True if the first bytes of a file are those of a format that its message names."""
    try:
        refuse_other_formats(path, path.name)
    except SpecError as error:
        # any archive may be a workbook
        return all(fault.code != "E0826" for fault in error.diagnostics)
    return False


def _marks(file: DataFile, data: Data, found: Sequence[Feed]) -> dict[ColumnKey, set[float | str]]:
    """The marks of missing values of each column: of its own entry, else of its set or of all.

    A column of several signals has the marks of all their entries.
    """
    marks: dict[ColumnKey, set[float | str]] = {}
    common = file.layout.missing or data.missing or ()
    for feed in found:
        own = common if feed.column is None else feed.column.missing or common
        for key in feed.keys if own else ():
            marks.setdefault(key, set()).update(
                value for mark in own for value in _numbers_too(mark.value)
            )
    return marks


def _numbers_too(mark: float | str) -> tuple[float | str, ...]:
    """The mark; of a text that is a number, such as "-9999", the number too."""
    if isinstance(mark, str) and is_number(mark) and math.isfinite(number := float(mark)):
        return mark, number
    return (mark,)


def _without_marked(
    read: ColumnTable | Streams, marks: Mapping[ColumnKey, set[float | str]]
) -> ColumnTable | Streams:
    """The columns with NaN instead of numbers that mark a missing value."""

    def measured(key: ColumnKey, values: FloatArray) -> FloatArray:
        numbers = [mark for mark in marks.get(key, ()) if not isinstance(mark, str)]
        # a file of 32-bit numbers holds the nearest one
        both = {*numbers, *(float(np.float32(mark)) for mark in numbers if abs(mark) < _FLOAT32)}
        marked = np.isin(values, sorted(both))
        return np.where(marked, np.nan, values) if both and marked.any() else values

    if isinstance(read, Streams):
        pairs = read.columns.items()
        return replace(read, columns={key: (t, measured(key, v)) for key, (t, v) in pairs})
    return replace(read, columns={key: measured(key, v) for key, v in read.columns.items()})


_FLOAT32 = float(np.finfo(np.float32).max)


def _time_source(file: DataFile, time: TimeColumn | None) -> TimeSource | None:
    """The spec's time column for formats that store times themselves; else None."""
    if time is None or not file.keeps_time:
        return None
    return TimeSource(time.column.column, time.place.value, time.unit)


def _with_name(fault: Diagnostic, file: DataFile) -> Diagnostic:
    """The diagnostic; if the file's format differs from its suffix, with the correct name."""
    is_unread = fault.code == "E0802" and fault.help is None and not file.has_lines
    return (
        replace(fault, help=other_name(file.path)) if is_unread and file.arrays is None else fault
    )


def _dialect(csv: Csv | None, *, tabs: bool) -> Dialect:
    plain = "\t" if tabs else ","
    if csv is None:
        return Dialect(delimiter=plain, is_usual=True)
    return Dialect(
        delimiter=csv.delimiter or plain,
        is_usual=csv.delimiter is None,
        decimal=csv.decimal,
        thousands=None if csv.thousands is None else csv.thousands.value,
        comment=csv.comment,
        header=csv.header,
        skip=csv.skip,
    )


def _in_seconds(
    read: ColumnTable | Streams, file: DataFile, column: TimeColumn | None, findings: Findings
) -> ColumnTable | Streams | None:
    """Columns with times converted to seconds; None after reporting errors."""
    if column is None:
        return read
    if isinstance(read, Streams):
        columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {}
        for key, (time, values) in read.columns.items():
            line = _to_seconds(column, read.time_units.get(key), file.shown, findings)
            if line is None:
                return None
            columns[key] = (converted_cells(time, line), values)
        return replace(read, columns=columns)
    if file.keeps_time:
        return read
    key = column.column.column
    begins = read.begins.get(key)
    if begins is not None and column.unit is not None:
        findings.report(
            data_units.unit_of_moments(str(key), column.unit.value.text, column.unit.span)
        )
        return None
    if column.zone is not None:
        return _in_zone(read, file, column, column.zone, findings)
    line = UNCHANGED
    if begins is None:
        line = _to_seconds(column, read.units.get(key), file.shown, findings)
    if line is None:
        return None
    return replace(read, time=converted_cells(read.columns[key], line), time_begins=begins)


def _in_zone(
    read: ColumnTable,
    file: DataFile,
    column: TimeColumn,
    zone: Located[str],
    findings: Findings,
) -> ColumnTable | None:
    """The table with times in UTC of a clock in a zone; None after reporting errors."""
    key = column.column.column
    begins = read.begins.get(key)
    if begins is None or begins.has_zone:
        kind = "numbers" if begins is None else "an offset from UTC in its dates"
        findings.report(
            data_units.other_kind_of_times("zone", str(key), file.shown, kind, zone.span)
        )
        return None
    found = utc_times(read.columns[key], begins, zone.value)
    for rows, twice in ((found.skipped, False), (found.doubtful, True)):
        if len(rows):
            row = int(rows[0])
            text = begins.text_after(float(read.columns[key][row]))
            findings.report(
                data_units.no_moment_in_zone(
                    file=file.shown,
                    row=row,
                    column=str(key),
                    text=text,
                    more=len(rows) - 1,
                    place=read.cell(row, key)[1],
                    zone=zone.value,
                    twice=twice,
                    standard=fixed_zone(begins, float(read.columns[key][row]), zone.value),
                )
            )
    if findings.failed:
        return None
    return replace(read, time=found.seconds, time_begins=found.begins)


def _time_unit(read: ColumnTable | Streams, column: TimeColumn | None) -> TimeUnit | None:
    if column is None or (isinstance(read, ColumnTable) and read.time_begins is not None):
        return None
    key = column.column.column
    stated = next(iter(read.time_units.values()), None) if isinstance(read, Streams) else None
    stated = read.units.get(key, stated)
    if isinstance(stated, CapitalUnit):
        stated = next(iter(stated.fitting(SECOND)), None)
    unit = stated if isinstance(stated, Unit) else SECOND
    unit = unit if column.unit is None else column.unit.value
    return TimeUnit(scalar_text(key, in_flow=True), unit)


def _to_seconds(
    column: TimeColumn, stated: StatedUnit | None, file: str, findings: Findings
) -> Line | None:
    """The conversion to seconds from the unit in the spec, else from the unit in the file."""
    place, key = column.place.value, str(column.column.column)
    if column.unit is not None:
        unit = column.unit.value
    else:
        unit = file_unit(stated, file, "time", key, SECOND, place, findings) or SECOND
    if unit.same_dimension(SECOND):
        return unit.line_to(SECOND)
    findings.report(misfit("time", key, unit, SECOND, place))
    return None
