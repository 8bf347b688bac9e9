"""Reads one file into the series of a program's signals, with its gaps and missing inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compiler.program import Program, Role
from msnn.data.columns import Feed, feeds, target_columns, wanted_columns
from msnn.data.csv_cells import line_of_row
from msnn.data.csv_file import Table, read_csv
from msnn.data.csv_header import ColumnKey, Dialect
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.files import DataFile
from msnn.data.rows import RowRange, TimeFault, continuity, picked_rows
from spec_schema.data_section import Csv, Data
from spec_schema.diagnostics import Diagnostic, Findings, SpecError
from spec_schema.errors import data_files as errors
from spec_schema.source import Span


@dataclass(frozen=True, slots=True)
class Part:
    """The picked rows of one file."""

    file: DataFile
    picked: RowRange
    series: dict[str, FloatArray]
    continues: BoolArray
    usable: BoolArray


def read_part(program: Program, data: Data, file: DataFile, findings: Findings) -> Part | None:
    """The rows of a file that the spec picks; None after a report of what is wrong."""
    mine = Findings()
    found = feeds(program.signals, {**data.columns, **file.layout.columns}, mine)
    dialect = _dialect(file.layout.csv or data.csv)
    time_column = file.layout.time or data.time
    time_key = None if time_column is None else time_column.column.column
    table = _table(file, data, found, dialect, time_key, mine)
    findings.report(*mine.in_order)
    if table is None or mine.failed:
        return None
    time = None
    if time_column is not None and time_key is not None:
        time = table.columns[time_key] * time_column.seconds
    picked = picked_rows(file.layout, data, file.shown, table.rows, time, findings)
    if picked is None:
        return None
    columns = {key: column[picked.rows] for key, column in table.columns.items()}
    series = {feed.signal.name: feed.series(columns) for feed in found}
    length = len(next(iter(columns.values())))
    continues = np.ones(length, dtype=np.bool_)
    continues[:1] = False
    if time is not None and program.sample_time is not None:
        continues, faults = continuity(time[picked.rows], picked, program.sample_time)
        if (file.layout.resample or data.resample or "error") == "error":
            for fault in faults:
                findings.report(_time_fault(fault, file, program.sample_time, table))
    usable = np.ones(length, dtype=np.bool_)
    for feed in found:
        if feed.signal.role is Role.INPUT:
            values = series[feed.signal.name].reshape(length, -1)
            usable &= np.isfinite(values).all(axis=1)
    return Part(file, picked, series, continues, usable)


def _table(
    file: DataFile,
    data: Data,
    found: Sequence[Feed],
    dialect: Dialect,
    time_key: ColumnKey | None,
    findings: Findings,
) -> Table | None:
    wanted = wanted_columns(found)
    optional = frozenset(wanted) if data.nan != "error" else target_columns(found)
    if time_key is not None:
        wanted[time_key] = "`time`"
        optional -= {time_key}
    try:
        return read_csv(file.path, file.shown, wanted, dialect, optional)
    except SpecError as error:
        findings.report(*error.diagnostics)
        return None


def _dialect(csv: Csv | None) -> Dialect:
    if csv is None:
        return Dialect()
    return Dialect(csv.delimiter, csv.decimal, csv.comment, csv.header, csv.skip)


def _time_fault(fault: TimeFault, file: DataFile, sample_time: float, table: Table) -> Diagnostic:
    line = line_of_row(file.path, table.header, fault.row)
    place = Span(file.shown, line, 1, line, 1)
    match fault.kind:
        case "gap":
            return errors.time_gap(
                file.shown, fault.row, fault.step, sample_time, fault.more, place
            )
        case "sample time":
            return errors.wrong_sample_time(file.shown, fault.step, sample_time, place)
        case "order":
            return errors.time_not_increasing(file.shown, fault.row, fault.more, place)
