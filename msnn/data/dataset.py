"""Measured data in memory: one series a signal, rows that belong to records, sets and episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spec_schema.diagnostics.diagnostic import Diagnostic

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

UNASSIGNED = -1


@dataclass(frozen=True, slots=True)
class Record:
    """The rows start … stop−1 of the series, all from one file."""

    file: str
    start: int
    stop: int
    first_row: int
    """Row of the file that `start` is."""
    every: int
    """Rows of the file between two rows of the record."""

    def file_row(self, row: int) -> int:
        """The row of the file that a row of the series was."""
        return self.first_row + (row - self.start) * self.every


@dataclass(frozen=True, slots=True)
class Dataset:
    """All records one after the other; memory is that of the signals, windows are never stored."""

    series: Mapping[str, FloatArray]
    """(rows, *shape) a signal, in the signal's unit; NaN where a value is missing."""
    records: tuple[Record, ...]
    sets: tuple[str, ...]
    set_of_row: NDArray[np.int8]
    """Index in `sets`, UNASSIGNED for rows of no set."""
    continues: BoolArray
    """Whether a row is one sample after the row before it: same record, no time gap."""
    usable: BoolArray
    """Whether a row has all inputs."""
    warnings: tuple[Diagnostic, ...] = ()

    @property
    def rows(self) -> int:
        return len(self.continues)

    def has(self, name: str) -> bool:
        """Whether any row belongs to the set."""
        return name in self.sets and bool(np.any(self.set_of_row == self.sets.index(name)))

    def in_set(self, name: str) -> BoolArray:
        """Which rows belong to the set."""
        if name not in self.sets:
            return np.zeros(self.rows, dtype=np.bool_)
        return self.set_of_row == self.sets.index(name)

    def episodes(self, name: str) -> IntArray:
        """(count, 2): start and stop of the maximal runs of one set without gap (rule R10)."""
        return self._runs(self.in_set(name) & self.usable)

    def stretches(self) -> IntArray:
        """(count, 2): start and stop of the maximal runs without gap, whatever the set."""
        return self._runs(self.usable)

    def _runs(self, wanted: BoolArray) -> IntArray:
        before = np.concatenate(([False], wanted[:-1]))
        after = np.concatenate((wanted[1:], [False]))
        follows = np.concatenate((self.continues[1:], [False]))
        starts = np.flatnonzero(wanted & ~(before & self.continues))
        last = np.flatnonzero(wanted & ~(after & follows))
        return np.stack((starts, last + 1), axis=1)


def one_record(series: Mapping[str, FloatArray], name: str = "data") -> Dataset:
    """Arrays of a session as a data set of one record, all of it in one set."""
    rows = len(next(iter(series.values())))
    continues = np.ones(rows, dtype=np.bool_)
    continues[:1] = False
    return Dataset(
        series=series,
        records=(Record(name, 0, rows, 0, 1),),
        sets=(name,),
        set_of_row=np.zeros(rows, dtype=np.int8),
        continues=continues,
        usable=np.ones(rows, dtype=np.bool_),
    )
