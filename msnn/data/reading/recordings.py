"""Joins consecutive files into recordings, before their rows are selected."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams
from msnn.data.reading.read_file import FileOrigin, ReadFile
from msnn.data.reading.record_rows import longest_gap, resampling
from msnn.data.reading.resample import longest_step
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Duration
from spec_schema.sections.data import Data

_TO = " … "


def recordings(
    files: Sequence[ReadFile], data: Data, sample_time: float | None, findings: Findings
) -> list[ReadFile]:
    """The files of a set with `join: true`; consecutive files become one recording.

    A file continues another if it begins one sample after its end; with `resample:`, if there is no
    hole between them. Recordings have the order of their first files. Reports files that are not
    joined.
    """
    clock = [_seconds_between(files[0], file) for file in files]
    gap = longest_gap(files[0].file, data)
    parts = [_Part.of(file, seconds, gap) for file, seconds in zip(files, clock, strict=True)]
    next_of: dict[int, int] = {}
    taken: set[int] = set()
    # by their beginnings: names of files are often in another order, as log_10 before log_2
    in_time = sorted((p.first, i) for i, p in enumerate(parts) if not math.isnan(p.first))
    for index, part in enumerate(parts):
        if sample_time is None or math.isnan(part.first):
            continue
        for at in range(bisect_right(in_time, (part.early_end, -1)), len(in_time)):
            begin, other = in_time[at]
            if begin > part.end + part.longest + longest_step(np.zeros(0), sample_time, gap):
                break
            if other == index or other in taken:
                continue
            if _follows(part, parts[other], data, sample_time):
                next_of[index] = other
                taken.add(other)
                break
    found: list[ReadFile] = []
    for index in range(len(files)):
        if index not in taken:
            chain = [index]
            while chain[-1] in next_of:
                chain.append(next_of[chain[-1]])
            found.append(_joined([files[i] for i in chain], [clock[i] for i in chain]))
    _report(parts, next_of, found, findings)
    return found


@dataclass(frozen=True, slots=True)
class _Part:
    """A file with its times in seconds on a common clock."""

    file: ReadFile
    times: Mapping[ColumnKey, FloatArray]
    first: float
    """NaN if the file's times cannot be compared with those of the others."""
    end: float
    early_end: float
    """The last time of the column that ends first."""
    longest: float
    """The longest step of any column that is not a hole."""

    @classmethod
    def of(cls, file: ReadFile, seconds: float, gap: float | Duration | None) -> _Part:
        times = {key: time + seconds for key, time in (file.times or {}).items() if len(time)}
        ends = [float(time[-1]) for time in times.values()] or [math.nan]
        first = min((float(time[0]) for time in times.values()), default=math.nan)
        longest = max((longest_step(time, 0.0, gap) for time in times.values()), default=0.0)
        return cls(file, times, first, max(ends), min(ends), longest)


def _seconds_between(one: ReadFile, other: ReadFile) -> float:
    """Seconds from time 0 of one file to that of another; NaN if the files do not determine it."""
    begins, ends = one.begins, other.begins
    if begins is None and ends is None:
        return 0.0
    # a date with a zone and one without cannot be compared
    if begins is None or ends is None or begins.has_zone != ends.has_zone:
        return math.nan
    return ends.seconds_from(begins)


def _follows(before: _Part, after: _Part, data: Data, sample_time: float) -> bool:
    if before.times.keys() != after.times.keys() or _unlike_columns(before.file, after.file):
        return False
    steps = {key: float(after.times[key][0] - time[-1]) for key, time in before.times.items()}
    layout = before.file.file.layout
    if resampling(before.file.file, data) is None:
        # as the rows of the file: `every` counts on in the next one
        step = sample_time / (layout.every or data.every or 1)
        return all(abs(one - step) <= GAP_TOLERANCE * sample_time for one in steps.values())
    # a column may have a hole between the files, as it may in one
    return min(steps.values()) > 0 and any(
        step <= longest_step(before.times[key], sample_time, longest_gap(before.file.file, data))
        for key, step in steps.items()
    )


def _unlike_columns(one: ReadFile, other: ReadFile) -> bool:
    """True if two files have different columns or different conversions."""
    feeds = zip((*one.found, *one.more), (*other.found, *other.more), strict=True)
    if any(a.keys != b.keys or a.lines != b.lines for a, b in feeds):
        return True
    return type(one.read) is not type(other.read)


def _joined(files: Sequence[ReadFile], clock: Sequence[float]) -> ReadFile:
    """One recording of consecutive files; `clock` has the time 0 of each."""
    first = files[0]
    if len(files) == 1:
        return first
    shifts = [seconds - clock[0] for seconds in clock]
    shown = f"{first.file.shown}{_TO}{files[-1].file.shown}"
    origins: list[FileOrigin] = []
    row = 0
    for file, shift in zip(files, shifts, strict=True):
        begin = min(float(time[0]) for time in (file.times or {}).values() if len(time)) + shift
        origin = FileOrigin(file.file.shown, row, begin, shift)
        # the rows of streams with several times are not those of one column
        if _has_rows(file.read):
            origin = replace(origin, remaining=file.origins[0].remaining)
        origins.append(origin)
        # streams with one time are rows too; those with several have none
        row += len(next(iter((file.times or {}).values())))
    return replace(
        first,
        file=replace(first.file, shown=shown),
        read=_one_table(files, shifts, origins),
        origins=tuple(origins),
    )


def _has_rows(read: ColumnTable | Streams) -> bool:
    """True if all columns have as many values."""
    return isinstance(read, ColumnTable) or len({len(t) for t, _ in read.columns.values()}) == 1


def _one_table(
    files: Sequence[ReadFile], shifts: Sequence[float], origins: Sequence[FileOrigin]
) -> ColumnTable | Streams:
    reads = [file.read for file in files]
    streams = [read for read in reads if isinstance(read, Streams)]
    keys = dict.fromkeys(key for read in reads for key in read.columns)
    if streams:
        none = (np.zeros(0), np.zeros(0))
        columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {}
        for key in keys:
            # a column that a file need not have is missing in it
            pairs = [read.columns.get(key, none) for read in streams]
            moments = [time + shift for (time, _), shift in zip(pairs, shifts, strict=True)]
            columns[key] = (np.concatenate(moments), np.concatenate([v for _, v in pairs]))
        return replace(streams[0], columns=columns)
    tables = [read for read in reads if isinstance(read, ColumnTable)]
    begins = [origin.row for origin in origins]

    def table_of(row: int) -> tuple[ColumnTable, int]:
        number = bisect_right(begins, row) - 1
        return tables[number], row - begins[number]

    def place(row: int) -> Span | None:
        table, own = table_of(row)
        return table.place(own)

    def cell(row: int, key: ColumnKey) -> tuple[str, Span | None]:
        table, own = table_of(row)
        return table.cell(own, key)

    times = [table.time for table in tables]
    seconds = [t + s for t, s in zip(times, shifts, strict=True) if t is not None]
    return replace(
        tables[0],
        columns={
            key: np.concatenate([t.columns.get(key, np.full(t.rows, np.nan)) for t in tables])
            for key in keys
        },
        time=np.concatenate(seconds),
        place=place,
        cell=cell,
    )


def _report(
    parts: Sequence[_Part],
    next_of: Mapping[int, int],
    found: Sequence[ReadFile],
    findings: Findings,
) -> None:
    """Reports files that are not joined, and the reason for the first pair."""
    if len(found) == 1 or not any(part.times for part in parts):
        return  # without times it is another message that says so
    in_time = sorted(range(len(parts)), key=lambda index: parts[index].first)
    apart = [(a, b) for a, b in pairwise(in_time) if next_of.get(a) != b]
    clocks = [(a, b) for a, b in apart if math.isnan(parts[a].first - parts[b].first)]
    over = [(a, b) for a, b in apart if parts[b].first <= parts[a].end]
    before, after = (parts[index] for index in (clocks or over or apart)[0])
    findings.report(
        errors.not_joined(
            before=before.file.file.shown,
            after=after.file.file.shown,
            seconds=after.first - before.end,
            columns_differ=_unlike_columns(before.file, after.file),
            files=len(parts),
            recordings=len(found),
            only_gaps=not clocks and not over,
            span=before.file.file.layout.place.key,
        )
    )
