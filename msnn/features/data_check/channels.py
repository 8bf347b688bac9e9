"""Extracts a scalar series for each element of a signal, with its place in the files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Program, Role, Signal
from msnn.data.dataset import BoolArray, Dataset, FloatArray, Record
from msnn.data.reading.resample import lost_values
from msnn.features.data_check.signals.sampling import follows
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One element of a signal over all rows of a dataset."""

    name: str
    """`u`, or `tau[2]` for a vector."""
    signal: Signal
    values: FloatArray
    left_out: BoolArray
    """Rows removed by a filter; `values` is NaN there."""
    missing: BoolArray
    """Rows without a value although the column usually has one."""

    @property
    def unit(self) -> str:
        """The unit to append to a number, with a leading blank."""
        return _after_number(self.signal.unit)

    @property
    def difference_unit(self) -> str:
        """The unit of a difference, to append to a number: K for degC."""
        return _after_number(self.signal.unit and self.signal.unit.difference)


@dataclass(frozen=True, slots=True, kw_only=True)
class RowsOfData:
    """The places of a dataset's rows, and their gaps, with a tolerance for jitter."""

    records: tuple[Record, ...]
    follows: BoolArray

    def place(self, row: int) -> str:
        """`row 17 of a.csv`, for messages."""
        return self.record(row).place(row)

    def record(self, row: int) -> Record:
        return next(record for record in self.records if record.start <= row < record.stop)


def rows_of(dataset: Dataset) -> RowsOfData:
    """The rows of a dataset; rows removed by a filter are gaps."""
    found = np.zeros(dataset.rows, dtype=np.bool_)
    for record in dataset.records:
        for piece in record.pieces:
            found[piece.start : piece.stop] = follows(piece.time, piece.stop - piece.start)
            # a record of several files may go on from one to the next
            if piece.start > record.start:
                found[piece.start] = dataset.continues[piece.start]
    return RowsOfData(records=dataset.records, follows=found)


def channels_of(
    program: Program, dataset: Dataset, resampled_to: float | None = None
) -> Iterator[Channel]:
    """Every element of every signal, inputs first, NaN in rows removed by a filter.

    If rows are later resampled to `resampled_to` seconds, empty cells between values of a slow
    column do not count as missing.
    """
    measured = np.ones(dataset.rows, dtype=np.bool_)
    inputs = [signal for signal in program.signals if signal.role is Role.INPUT]
    for signal in inputs:
        measured &= np.isfinite(dataset.series[signal.name].reshape(dataset.rows, -1)).all(axis=1)
    # rows that a filter took out are no measurement; those with a missing input are missing already
    filtered = measured & ~dataset.usable
    ordered = sorted(program.signals, key=lambda signal: signal.role is not Role.INPUT)
    for signal in ordered:
        size = math.prod(axis.size for axis in signal.axes)
        table = dataset.series[signal.name].reshape(dataset.rows, size)
        for element in range(size):
            recorded = table[:, element]
            missing = ~np.isfinite(recorded)
            if resampled_to is not None:
                missing = _lost(dataset, recorded, resampled_to)
            values = np.where(filtered, np.nan, recorded)
            name = signal.name if not signal.axes else f"{signal.name}[{element}]"
            yield Channel(
                name=name,
                signal=signal,
                values=values,
                left_out=filtered,
                missing=missing & ~filtered,
            )


def _lost(dataset: Dataset, values: FloatArray, sample_time: float) -> BoolArray:
    """The rows without a value that resampling cannot interpolate."""
    found = np.zeros(dataset.rows, dtype=np.bool_)
    for piece in (piece for record in dataset.records for piece in record.pieces):
        own = values[piece.start : piece.stop]
        if piece.time is None:
            found[piece.start : piece.stop] = ~np.isfinite(own)
        else:
            found[piece.start + lost_values((piece.time, own), sample_time)] = True
    return found


def _after_number(unit: Unit | None) -> str:
    return "" if unit is None or unit.text == "1" else f" {unit.text}"
