"""Reads one file into the series of a program's signals, with its gaps and missing inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from compiler.ir.program import Program, Role, Signal
from msnn.data.dataset import BoolArray, FileRows, FloatArray, IntArray
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.reading.columns import (
    Feed,
    columns_of_only,
    feeds,
    in_units_of_file,
    wanted_columns,
)
from msnn.data.reading.files import DataFile
from msnn.data.reading.record_rows import ColumnUses, RecordRows, record_rows, resampling
from msnn.data.reading.row_filter import RowFilter
from msnn.data.reads import compared_signals, signals_only_compared
from msnn.errors.data import formats as data_formats
from msnn.errors.data.files import no_column_read
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.expressions.moments import Moment
from spec_schema.sections.data.data import Csv, Data, TimeColumn

_TO = " … "


@dataclass(frozen=True, slots=True)
class KeptValues:
    """The measured values of a column, by what resampling made of them."""

    measured: int
    kept: int
    """Rows that have one."""
    lost: int
    """Values for which there is no row, or only one at which an input is missing."""
    rows: int
    """All rows, with and without a value."""
    offset: float = 0.0
    """Most seconds between a value and its row, of those that are taken as they were measured."""

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
    """The picked rows of one file, or of several that follow each other."""

    file: DataFile
    pieces: tuple[FileRows, ...]
    series: dict[str, FloatArray]
    time: FloatArray | None
    """Seconds of each row, where the file says."""
    continues: BoolArray
    usable: BoolArray
    begins: Moment | None = None
    """Time 0, where the file says."""
    kept: Mapping[ColumnKey, KeptValues] = field(default_factory=dict[ColumnKey, KeptValues])
    """Of resampled columns that predictions are compared with."""
    measured: Mapping[str, BoolArray] = field(default_factory=dict[str, BoolArray])
    """Of resampled signals that are read as well as compared: the rows with a measured value."""

    def seconds_to(self, other: FilePart) -> float:
        """From the time 0 of this one to that of another; NaN where the files do not tell."""
        begins, ends = self.begins, other.begins
        if begins is None and ends is None:
            return 0.0
        if begins is None or ends is None or begins.has_zone != ends.has_zone:
            return math.nan
        return ends.seconds_from(begins)

    def with_next(self, other: FilePart) -> FilePart:
        """One record of this one and of another that begins one sample later."""
        assert self.time is not None
        assert other.time is not None
        first = self.file.shown.split(_TO)[0]
        continues = np.concatenate((self.continues, other.continues))
        # the only row whose flag says "begins a record" and no longer does
        continues[len(self.continues)] = True
        return FilePart(
            file=replace(self.file, shown=f"{first}{_TO}{other.file.shown}"),
            pieces=(*self.pieces, *(piece.moved(len(self.continues)) for piece in other.pieces)),
            series={n: np.concatenate((v, other.series[n])) for n, v in self.series.items()},
            time=np.concatenate((self.time, other.time + self.seconds_to(other))),
            continues=continues,
            usable=np.concatenate((self.usable, other.usable)),
            begins=self.begins,
            measured={n: np.concatenate((m, other.measured[n])) for n, m in self.measured.items()},
        )


def read_part(
    program: Program,
    data: Data,
    file: DataFile,
    row_filter: RowFilter | None,
    findings: Findings,
    beside: Sequence[Signal] = (),
) -> FilePart | None:
    """The rows of a file that the spec picks; None after a report of what is wrong.

    `beside` are signals that the file need not have: their series are NaN then.
    """
    # of its own: `failed` is then about this file alone
    mine = Findings()
    columns = {**data.columns, **file.layout.columns}
    compared, lone = compared_signals(program), signals_only_compared(program)
    found = feeds(_signals(program, row_filter), columns, mine)
    more = feeds(beside, columns, mine)
    read = _read(file, data, found, more, mine)
    rows = None
    if read is not None:
        found = in_units_of_file(found, read.units, file.shown, mine)
        more = in_units_of_file(more, read.units, file.shown, mine)
    if isinstance(read, ColumnTable) and not read.columns and not mine.failed:
        mine.report(no_column_read(file.shown, program.name))
    if read is not None and not mine.failed:
        # a column that a signal of the program needs as well may not be missing
        spare = wanted_columns(more).keys() - wanted_columns(found).keys()
        targets = {f.signal.name for f in found if f.signal.role is Role.TARGET}
        scored = columns_of_only(found, targets | lone)
        keys = frozenset(k for feed in found if feed.signal.name in compared for k in feed.keys)
        uses = ColumnUses(beside=frozenset(spare), scored=scored, compared=keys - spare)
        rows = record_rows(read, file, data, program.sample_time, mine, uses)
    findings.report(*mine.in_order)
    if rows is None:
        return None
    series = {feed.signal.name: feed.series(rows.columns) for feed in found}
    # a row in a hole is no measurement, a row without an input cannot be simulated; both end an
    # episode
    usable = rows.covered.copy()
    if not usable.all():
        for values in series.values():
            values[~usable] = np.nan  # what resampling drew through a hole was not measured
    for feed in found:
        # missing targets are only not scored (R9)
        if feed.signal.role is Role.INPUT and feed.signal in program.signals:
            # a prediction alone is compared with it
            if rows.measured.keys() >= set(feed.keys):
                continue
            values = series[feed.signal.name].reshape(len(usable), -1)
            usable &= np.isfinite(values).all(axis=1)
    single = columns_of_only(found, lone) & rows.measured.keys()
    offsets = {key: rows.offsets[key] for key in single}
    kept = {
        key: _kept_values(moments, usable, offsets.get(key, 0.0))
        for key, moments in rows.moments.items()
    }
    if row_filter is not None:
        usable &= _kept(row_filter, series, rows, file, findings)
    # after the filter, which may read between measured values
    columns = {**rows.columns, **{key: _at_moments(key, rows) for key in single}}
    series |= {feed.signal.name: feed.series(columns) for feed in found if single & set(feed.keys)}
    # of an input that the model reads, values between those measured are there, not scored
    measured = {
        feed.signal.name: np.all([_marked(key, rows) for key in read], axis=0)
        for feed in found
        if (read := set(feed.keys) & rows.moments.keys() - single) and feed.signal.name in compared
    }
    # what only the filter read is not kept
    series = {signal.name: series[signal.name] for signal in program.signals}
    series |= {feed.signal.name: feed.series_if_there(rows.columns, len(usable)) for feed in more}
    piece = FileRows(file=file.shown, start=0, stop=len(usable), rows=rows.rows, time=rows.time)
    return FilePart(
        file=file,
        pieces=(piece,),
        series=series,
        time=rows.time,
        continues=rows.continues,
        usable=usable,
        begins=rows.begins,
        kept=kept,
        measured=measured,
    )


def _kept_values(moments: IntArray, usable: BoolArray, offset: float) -> KeptValues:
    there = moments[moments >= 0]
    there = there[usable[there]]
    lost = len(moments) - len(there)
    return KeptValues(len(moments), len(np.unique(there)), lost, len(usable), offset)


def _at_moments(key: ColumnKey, rows: RecordRows) -> FloatArray:
    """The measured values of a resampled column in their rows; NaN elsewhere and in holes."""
    return np.where(rows.covered, rows.measured[key], np.nan)


def _marked(key: ColumnKey, rows: RecordRows) -> BoolArray:
    """The rows to which a measured value of a resampled column belongs."""
    marked = np.zeros(len(rows.continues), dtype=np.bool_)
    marked[rows.moments[key][rows.moments[key] >= 0]] = True
    return marked


def _signals(program: Program, row_filter: RowFilter | None) -> tuple[Signal, ...]:
    """The signals of the program and those that only the filter reads."""
    known = {signal.name for signal in program.signals}
    more = () if row_filter is None else row_filter.signals
    return (*program.signals, *(signal for signal in more if signal.name not in known))


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


def _read(
    file: DataFile, data: Data, found: Sequence[Feed], more: Sequence[Feed], findings: Findings
) -> ColumnTable | Streams | None:
    needed = wanted_columns(found)
    users = {**wanted_columns(more), **needed}
    # a column that both need is needed
    spare = frozenset(users) - frozenset(needed)
    targets = {feed.signal.name for feed in found if feed.signal.role is not Role.INPUT}
    # resampling knows which missing values it fills
    may_all_miss = data.nan != "error" or resampling(file, data) is not None
    optional = spare | (frozenset(users) if may_all_miss else columns_of_only(found, targets))
    time = file.layout.time or data.time
    moments = frozenset[ColumnKey]()
    if time is not None and not file.keeps_time:
        moments = frozenset({time.column.column})
        users[time.column.column] = "`time`"
        # without time nobody knows how rows follow each other, whatever `nan:` says of values
        optional -= {time.column.column}
        spare -= {time.column.column}
    try:
        wanted = WantedColumns(users, optional, spare, moments, _time_source(file, time))
        if file.arrays is not None:
            return file.arrays.table(wanted)
        dialect = _dialect(file.layout.csv or data.csv, tabs=file.path.suffix.lower() == ".tsv")
        return file.format.reader(file.path, file.shown, wanted, dialect)
    except SpecError as error:
        findings.report(*error.diagnostics)
        return None


def _time_source(file: DataFile, time: TimeColumn | None) -> TimeSource | None:
    """The column that the spec names, for files whose reader finds the times of values itself."""
    if time is None or not file.keeps_time:
        return None
    return TimeSource(time.column.column, time.place.value, time.unit)


def _dialect(csv: Csv | None, *, tabs: bool) -> Dialect:
    plain = "\t" if tabs else ","
    if csv is None:
        return Dialect(delimiter=plain, is_usual=True)
    return Dialect(
        delimiter=csv.delimiter or plain,
        is_usual=csv.delimiter is None,
        decimal=csv.decimal,
        comment=csv.comment,
        header=csv.header,
        skip=csv.skip,
    )
