"""Holds measured data: one series per signal, and its rows by recording, set and episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from backends.files.disk_arrays import AT_ONCE, DiskArray
from compiler.ir.program import UsedPlugin
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

UNASSIGNED = -1

BETWEEN_ROWS = -1
"""The row index of a resampled time that lies between the rows of the file."""


@dataclass(frozen=True, slots=True)
class TimeUnit:
    """The time column of a file as named in the spec, and the unit in which it was read."""

    column: str
    unit: Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class FileRows:
    """The rows start … stop−1 of the series, all from one file, and their row indices in that
    file.
    """

    file: str
    start: int
    stop: int
    rows: range | IntArray
    """Row in the file for each row, counted from 0 below the header; BETWEEN_ROWS if resampled."""
    time: FloatArray | None
    """Time of each row in seconds, from the file; None if the file has no time."""
    time_begins: float = 0.0
    """Time 0 of the file on the clock of its recording, in s; non-zero if files are joined by
    date.
    """
    time_unit: TimeUnit | None = None
    """None if the spec names no time column, or if the times are dates."""

    def moved(self, by: int) -> FileRows:
        """The same rows of the file, shifted by `by` rows in the series."""
        return replace(self, start=self.start + by, stop=self.stop + by)

    def row(self, row: int) -> int:
        """The row in the file of a row of the series."""
        return int(self.rows[row - self.start])

    def shared_with(self, other: FileRows) -> int:
        """The number of rows that both selections of the same file contain."""
        mine, others = np.asarray(self.rows), np.asarray(other.rows)
        if (mine == BETWEEN_ROWS).any() or (others == BETWEEN_ROWS).any():
            # moments between rows: those within the time of the other
            if self.time is None or other.time is None or not len(self.time) * len(other.time):
                return 0
            return int(((self.time >= other.time[0]) & (self.time <= other.time[-1])).sum())
        return len(np.intersect1d(mine, others))

    def file_rows(self, first: int, stop: int) -> IntArray:
        """Rows in the file, (stop−first,), of the rows first … stop−1 of the series."""
        return np.asarray(self.rows[first - self.start : stop - self.start], np.int64)

    def times(self, first: int, stop: int, sample_time: float | None) -> FloatArray | None:
        """Times of the rows first … stop−1 in seconds, on the clock of the recording's first file.

        Without a time column, time is 0 at the file's row 0. None if times cannot be derived.
        """
        if self.time is not None:
            return self.time[first - self.start : stop - self.start] + self.time_begins
        if sample_time is None or not isinstance(self.rows, range):
            return None
        # rows selected by `every:` are one sample apart
        return self.file_rows(first, stop) / self.rows.step * sample_time


@dataclass(frozen=True, slots=True)
class Record:
    """The rows start … stop−1 of the series: one file, or several consecutive in time."""

    file: str
    start: int
    stop: int
    pieces: tuple[FileRows, ...]
    """The rows of each file, in the order of the files."""

    def piece(self, row: int) -> FileRows:
        """The file that contains a row of the series."""
        return next(piece for piece in self.pieces if piece.start <= row < piece.stop)

    def place(self, row: int) -> str:
        """`row 17 of train/a.csv`, for messages."""
        piece = self.piece(row)
        if (found := piece.row(row)) != BETWEEN_ROWS or piece.time is None:
            return f"row {found} of {piece.file}"
        return f"{float(piece.time[row - piece.start]):.6g} s in {piece.file}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """All recordings one after the other. Windows are views of the series and are never stored."""

    series: Mapping[str, FloatArray]
    """(rows, *shape) per signal, in the signal's unit; NaN if a value is missing."""
    records: tuple[Record, ...]
    sets: tuple[str, ...]
    set_of_row: NDArray[np.int8]
    """Index in `sets`; UNASSIGNED for rows that belong to no set."""
    continues: BoolArray
    """True for a row one sample after the previous row: same recording, no time gap."""
    usable: BoolArray
    """True for a row in which no input is missing."""
    warnings: tuple[Diagnostic, ...] = ()
    measured: Mapping[str, BoolArray] = field(default_factory=dict[str, BoolArray])
    """Masks of measured rows, for signals whose other rows hold interpolated values."""

    plugins: Mapping[str, UsedPlugin] = field(default_factory=dict[str, UsedPlugin])
    """The plug-ins that read the files, by suffix."""

    def measured_values(self, name: str) -> FloatArray:
        """(rows, *shape) of a signal, with NaN instead of interpolated values."""
        values = self.series[name]
        if name not in self.measured:
            return values
        found = np.array(values)
        found[~self.measured[name]] = np.nan
        return found

    @property
    def rows(self) -> int:
        return len(self.continues)

    def record_of(self, row: int) -> Record:
        """The recording that a row belongs to."""
        return next(record for record in self.records if record.start <= row < record.stop)

    def place(self, row: int) -> str:
        """`row 17 of train/a.csv`, for messages."""
        return self.record_of(row).place(row)

    def has(self, name: str) -> bool:
        """True if any row belongs to the set."""
        return bool(self.in_set(name).any())

    def in_set(self, name: str) -> BoolArray:
        """The mask of the rows that belong to the set."""
        if name not in self.sets:
            return np.zeros(self.rows, dtype=np.bool_)
        return self.set_of_row == self.sets.index(name)

    @property
    def is_on_disk(self) -> bool:
        """True if the series are files on disk, which may be larger than memory."""
        return any(isinstance(values, DiskArray) for values in self.series.values())

    def episodes(self, name: str) -> IntArray:
        """(count, 2): start and stop of the maximal intervals of one set without a gap (rule
        R10).
        """
        if name not in self.sets:
            return np.zeros((0, 2), np.int64)
        code = self.sets.index(name)
        return self._runs(lambda rows: (self.set_of_row[rows] == code) & self.usable[rows])

    def stretches(self) -> IntArray:
        """(count, 2): start and stop of the maximal intervals without a gap, regardless of sets."""
        return self._runs(lambda rows: self.usable[rows])

    def _runs(self, wanted: Callable[[slice], BoolArray]) -> IntArray:
        starts: list[IntArray] = []
        stops: list[IntArray] = []
        none = np.zeros(1, np.bool_)
        # in parts: series on disk may have more rows than memory takes flags for
        for begin in range(0, self.rows, AT_ONCE):
            end = min(begin + AT_ONCE, self.rows)
            # one row more on each side, which no run leaves the data by
            left, right = int(begin > 0), int(end < self.rows)
            around = wanted(slice(begin - left, end + right))
            inside = around[left : left + end - begin]
            before = around[: end - begin] if left else np.concatenate((none, inside[:-1]))
            after = around[left + 1 :] if right else np.concatenate((inside[1:], none))
            follows = self.continues[begin + 1 : end + right]
            follows = follows if right else np.concatenate((follows, none))
            # begins where the row before is no part of the run, or is more than one sample away
            starts.append(begin + np.flatnonzero(inside & ~(before & self.continues[begin:end])))
            # exclusive
            stops.append(begin + np.flatnonzero(inside & ~(after & follows)) + 1)
        empty = [np.zeros(0, np.int64)]
        return np.stack((np.concatenate(starts or empty), np.concatenate(stops or empty)), axis=1)
