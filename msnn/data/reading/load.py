"""Reads all data of a spec into one dataset, in memory or on disk, and reports all faulty files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from backends.files.disk_arrays import ArrayFile
from backends.native.kernel_cache import cache_folder
from compiler.ir.program import Program, Signal, UsedPlugin
from msnn.data.dataset import BoolArray, Dataset, FileRows, FloatArray, Record
from msnn.data.formats.table import ColumnKey, ColumnTable
from msnn.data.formats.table_of_formats import (
    format_plugins,
    require_formats,
    require_reader,
    warnings_of_plugins,
)
from msnn.data.reading.files import DataFile, find_files, unused_keys
from msnn.data.reading.part import FilePart, KeptValues, part_of
from msnn.data.reading.read_file import ReadFile, read_file
from msnn.data.reading.recordings import recordings
from msnn.data.reading.row_filter import RowFilter
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.data.reading.splits import RecordTimes, SetCodes, split_rows, split_source
from msnn.data.rollout_rows import measured_beside
from msnn.errors.data import rows as errors
from msnn.errors.data.files import not_on_disk, rows_in_two_sets
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.sections.data import Data

_LARGEST_SHOWN = 1_000_000


def load_data(
    program: Program,
    data: Data,
    folder: Path,
    filters: Mapping[str, RowFilter] | None = None,
    whole: Program | None = None,
    *,
    as_recorded: bool = False,
    recorded: Mapping[str, UsedPlugin | None] | None = None,
) -> Dataset:
    """The measured series of all signals of the program, divided into recordings and sets.

    Relative paths start in `folder`: the spec's folder, or `--data-root`. `filters` maps names of
    sources to row filters. `whole` is the complete model of which `program` is a part; signals that
    only `whole` predicts are read if a file has them. `as_recorded` joins files as for `resample:`,
    but keeps their rows. `recorded` are the plug-ins that read the data of a run, by suffix.

    Raises SpecError with the errors of all files, and MissingExtraError if a required reader or the
    plug-in of a run is not installed.
    """
    findings = Findings()
    files = find_files(data, folder, findings)
    for file in files:
        # check all formats before reading the first file: a missing package is reported immediately
        require_reader(file.path)
        findings.report(*warnings_of_plugins(file.path))
    if recorded:
        findings.report(*require_formats(_paths(files), recorded))
    findings.report(*unused_keys(data, files, program.sample_time))
    return joined_files(program, data, files, filters or {}, findings, whole, as_recorded)


def _paths(files: Iterable[DataFile]) -> list[Path]:
    return [file.path for file in files if file.arrays is None]


def joined_files(
    program: Program,
    data: Data,
    files: Sequence[DataFile],
    filters: Mapping[str, RowFilter],
    findings: Findings,
    whole: Program | None = None,
    as_recorded: bool = False,
) -> Dataset:
    """The dataset of these files, or of arrays in memory. Raises SpecError with all errors."""
    disk = DiskSeries() if data.keep == "disk" else None
    if disk is not None and (data.join or any(source.join for source in data.source.values())):
        reason = "`join: true` puts files together in memory"
        findings.report(not_on_disk(reason, data.place.key))
    # without time rows are independent: none of a record falls with another
    drops = data.nan == "drop" and program.sample_time is not None
    parts: list[FilePart] = []
    # told behind the faults of files: with those nothing was dropped for good
    left_out = Findings()
    outside: dict[tuple[str, Path], Findings] = {}
    reached: set[tuple[str, Path]] = set()
    for group in _groups(files, data):
        condition = filters.get(group[0].source)
        for recording in _recordings(program, data, group, condition, findings, whole):
            if as_recorded and isinstance(recording.read, ColumnTable):
                recording = recording.as_recorded()
            own, file = Findings(), recording.file
            part = part_of(recording, program, data, condition, own)
            if part is None and _is_outside(file, own):
                outside.setdefault((file.source, file.path), own)
                continue
            reached.add((file.source, file.path))
            findings.report(*own.since(0))
            if part is None or (drops and _dropped(part, left_out)):
                continue
            parts.append(part if disk is None else disk.taken(part))
    for file, own in outside.items():
        if file not in reached:
            findings.report(*own.since(0))
    if findings.failed:
        if disk is not None:
            disk.forget()
        faults = _once(findings.in_order)
        raise SpecError(faults, _texts(files, faults))
    for warning in left_out.in_order:
        findings.report(warning)
    on_disk = None
    if disk is not None:
        parts, on_disk = disk.returned(parts)
    _report_kept(parts, program.sample_time, findings)
    sets = data.sets
    rows = _sets(data, parts, sets, program.sample_time, findings)
    if not findings.failed:
        _report_shared(parts, files, data, findings)
    beside = () if whole is None else measured_beside(whole, program)
    signals = (*program.signals, *beside)
    _report_ranges(signals, parts, findings)
    findings.raise_errors()
    # what is said of a column is said once, not of each file
    warnings = tuple(dict.fromkeys(findings.in_order))
    found = _joined(signals, parts, sets, rows, warnings, on_disk)
    return replace(found, plugins=format_plugins(_paths(files)))


def _is_outside(file: DataFile, own: Findings) -> bool:
    """True if a row group has no row between `from` and `to`, though other groups may have."""
    faults = [found.code for found in own.since(0) if found.severity == "error"]
    return file.is_row_group and faults == ["E0818"]


def _texts(files: Iterable[DataFile], faults: Iterable[Diagnostic]) -> list[SourceText]:
    """The texts of faulty files, so that messages can show the line; large files are omitted."""
    faulty = {fault.span.file for fault in faults if fault.span is not None}
    return [
        SourceText(file.shown, file.path.read_text("utf-8-sig", errors="replace"))
        for file in files
        if file.shown in faulty and file.has_lines and file.path.stat().st_size <= _LARGEST_SHOWN
    ]


def _once(faults: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Merges diagnostics that differ only in the file; the result names the first file."""
    alike: dict[Diagnostic, list[Diagnostic]] = {}
    for fault in faults:
        file = "" if fault.span is None else fault.span.file
        # a fault without a place says nothing of which file it is in
        kind = replace(fault, message=fault.message.replace(file, ""), span=None) if file else fault
        alike.setdefault(kind, []).append(fault)
    return [
        same[0].also_in(len({f.span and f.span.file for f in same}) - 1) for same in alike.values()
    ]


def _dropped(part: FilePart, findings: Findings) -> bool:
    if part.missing is None:
        return False
    findings.report(errors.record_dropped(part.file.shown, *part.missing))
    return True


def _groups(files: Sequence[DataFile], data: Data) -> Iterator[list[DataFile]]:
    """Each file alone, except that files of a set with `join: true` form one group."""
    joining: dict[str, list[DataFile]] = {}
    for file in files:
        if file.layout.join if file.layout.join is not None else data.join:
            joining.setdefault(file.source, []).append(file)
    for file in files:
        group = joining.get(file.source, [file])
        if file is group[0]:
            yield group
        elif file not in group:
            yield [file]


def _recordings(
    program: Program,
    data: Data,
    group: Sequence[DataFile],
    condition: RowFilter | None,
    findings: Findings,
    whole: Program | None,
) -> list[ReadFile]:
    """The recordings of a group: consecutive files become one. Reports faulty files."""
    own = Findings()
    read = [read_file(program, data, file, condition, own, whole) for file in group]
    findings.report(*own.since(0))
    found = [file for file in read if file is not None]
    if len(group) == 1 or len(found) < len(group) or findings.failed:
        return found
    return recordings(found, data, program.sample_time, findings)


def _sets(
    data: Data,
    parts: Sequence[FilePart],
    sets: Sequence[str],
    sample_time: float | None,
    findings: Findings,
) -> list[SetCodes]:
    """The set index of every row of every part."""
    codes = {name: index for index, name in enumerate(sets)}
    # int8: a byte a row, as there are no 127 sets
    rows = [np.full(len(p.usable), codes[p.file.source], dtype=np.int8) for p in parts]
    if data.split is None:
        return rows
    divided = split_source(tuple(data.source), data.split, findings)
    chosen = [index for index, part in enumerate(parts) if part.file.source == divided]
    needs_time = data.split.by == "time"
    records = [_times(parts[index], sample_time if needs_time else None) for index in chosen]
    for index, codes_of_rows in zip(
        chosen, split_rows(data.split, records, codes, findings), strict=True
    ):
        rows[index] = codes_of_rows
    return rows


def _times(part: FilePart, sample_time: float | None) -> RecordTimes:
    time = part.time
    if time is None and sample_time is not None:
        # no column says it: rows are samples, one every `sample_time`
        time = np.arange(len(part.usable), dtype=np.float64)
        time *= sample_time
    return RecordTimes(len(part.usable), time, part.begins, part.file.shown)


def _report_ranges(
    signals: Sequence[Signal], parts: Sequence[FilePart], findings: Findings
) -> None:
    """Warns of data outside a signal's `range:`; values are never clamped (rule R10)."""
    for signal in signals:
        if signal.range is None:
            continue
        low, high = signal.range
        excess = 0.0
        worst, count, place = 0.0, 0, ""
        for part in parts:
            values = part.series[signal.name]
            # fmax, since a missing value is no value outside
            beyond = np.fmax(low - values, values - high)
            count += int(np.sum(beyond > 0))
            most = float(np.nanmax(beyond, initial=0.0)) if beyond.size else 0.0
            if most > excess:
                excess = most
                index = int(np.nanargmax(beyond))
                worst = float(values.ravel()[index])
                # (rows, *shape) in C order: elements of a row follow each other
                row = index * len(values) // values.size
                place = Record(part.file.shown, 0, len(values), part.pieces).place(row)
        if count:
            unit = f" {signal.unit.text}" if signal.unit else ""
            findings.report(
                errors.outside_range(
                    signal=signal.name,
                    count=count,
                    worst=worst,
                    low=low,
                    high=high,
                    unit=unit,
                    place=place,
                )
            )


def _report_shared(
    parts: Sequence[FilePart], files: Sequence[DataFile], data: Data, findings: Findings
) -> None:
    """Warns of rows of one file that are in two sets: an evaluation would use training data."""
    paths = {(file.source, file.shown): file for file in files}
    seen: dict[object, list[tuple[str, FileRows]]] = {}
    for part in parts:
        for piece in part.pieces:
            file = paths[part.file.source, piece.file]
            # arrays of a session have no path, row groups share one
            path = file.path if file.arrays else file.path.resolve()
            key = (path, file.shown if file.is_row_group else "")
            for name, other in seen.setdefault(key, []):
                count = piece.shared_with(other) if name != part.file.source else 0
                if count:
                    sets = (name, part.file.source)
                    place = data.source[part.file.source].place.key
                    findings.report(
                        rows_in_two_sets(file=file.shown, sets=sets, rows=count, span=place)
                    )
            seen[key].append((part.file.source, piece))


def _report_kept(parts: Sequence[FilePart], sample_time: float | None, findings: Findings) -> None:
    """Reports how resampling mapped measured values to rows, unless each row has exactly one."""
    total: dict[ColumnKey, KeptValues] = {}
    for part in parts:
        for key, kept in part.kept.items():
            total[key] = total[key] + kept if key in total else kept
    for key, kept in total.items():
        if not kept.measured == kept.kept == kept.rows:
            findings.report(
                errors.kept_values(
                    column=str(key),
                    measured=kept.measured,
                    kept=kept.kept,
                    lost=kept.lost,
                    rows=kept.rows,
                    offset=kept.offset if kept.offset > GAP_TOLERANCE * (sample_time or 0) else 0.0,
                )
            )


def _joined(
    signals: Sequence[Signal],
    parts: Sequence[FilePart],
    sets: tuple[str, ...],
    rows: Sequence[SetCodes],
    warnings: tuple[Diagnostic, ...],
    whole: Mapping[str, FloatArray] | None,
) -> Dataset:
    """The dataset of all parts in sequence; `whole` has their series if they are on disk."""
    records: list[Record] = []
    start = 0
    for part in parts:
        stop = start + len(part.usable)
        pieces = tuple(piece.moved(start) for piece in part.pieces)
        records.append(Record(part.file.shown, start, stop, pieces))
        start = stop
    none = np.zeros(0, dtype=np.bool_)
    return Dataset(
        # an empty mapping of a program without signals is none either
        series=whole
        or {
            signal.name: _in_sequence(
                [part.series[signal.name] for part in parts]
                or [np.zeros((0, *(axis.size for axis in signal.axes)))]
            )
            for signal in signals
        },
        records=tuple(records),
        sets=sets,
        set_of_row=np.concatenate([np.zeros(0, dtype=np.int8), *rows]),
        continues=np.concatenate([none, *(part.continues for part in parts)]),
        usable=np.concatenate([none, *(part.usable for part in parts)]),
        warnings=warnings,
        measured=_measured(parts),
    )


def _in_sequence(series: Sequence[FloatArray]) -> FloatArray:
    """The rows of all arrays in one; a single array as it is, which may be large."""
    return series[0] if len(series) == 1 else np.concatenate(series)


def _measured(parts: Sequence[FilePart]) -> dict[str, BoolArray]:
    """The rows with a measured value, for signals that lack one in some rows."""
    names = dict.fromkeys(name for part in parts for name in part.measured)
    found = {
        # a part that is not resampled has the values that its file has
        name: np.concatenate(
            [part.measured.get(name, np.ones(len(part.usable), np.bool_)) for part in parts]
        )
        for name in names
    }
    return {name: rows for name, rows in found.items() if not rows.all()}


_TIME = "time of rows"
"""A key that no signal has, because names of signals contain no blanks."""


class DiskSeries:
    """The series of all parts in unnamed files in the cache folder, one per signal."""

    def __init__(self) -> None:
        self._files: dict[str, ArrayFile] = {}

    def taken(self, part: FilePart) -> FilePart:
        """Appends the series of the part to disk, and returns the part without series."""
        series = part.series if part.time is None else {**part.series, _TIME: part.time}
        for name, values in series.items():
            if name not in self._files:
                # not in /tmp, which often is memory
                self._files[name] = ArrayFile(cache_folder())
            self._files[name].append(values)
        # the times of rows go to disk, too: they are as many as a signal's values
        pieces = tuple(replace(piece, time=None) for piece in part.pieces)
        empty = None if part.time is None else part.time[:0].copy()
        return replace(part, series={}, time=empty, pieces=pieces)

    def forget(self) -> None:
        """Deletes all files."""
        for file in self._files.values():
            file.forget()

    def returned(
        self, parts: Sequence[FilePart]
    ) -> tuple[list[FilePart], Mapping[str, FloatArray]]:
        """The parts with views of their series on disk, and the whole series by signal."""
        whole = {name: file.array() for name, file in self._files.items()}
        # one array for all parts, of which some may have none
        time = whole.pop(_TIME, None)
        found: list[FilePart] = []
        start = timed = 0
        for part in parts:
            rows = len(part.usable)
            own = {name: values[start : start + rows] for name, values in whole.items()}
            start += rows
            if part.time is None or time is None:
                found.append(replace(part, series=own))
                continue
            seconds = time[timed : timed + rows]
            timed += rows
            pieces = tuple(replace(piece, time=seconds) for piece in part.pieces)
            found.append(replace(part, series=own, time=seconds, pieces=pieces))
        return found, whole
