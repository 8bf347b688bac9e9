"""Reads the data of a spec without changes, as one scalar series per element of a signal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compiler.ir.program import Program, Role, Signal
from msnn.data.dataset import BoolArray, Dataset, FloatArray, Record
from msnn.data.reading.file_sets import file_sections
from msnn.data.reading.files import data_of_files
from msnn.data.reading.frames import Frames, frame_data
from msnn.data.reading.load import load_data
from msnn.data.reading.resample import lost_values
from msnn.data.reading.row_filter import row_filters
from msnn.errors.commands import no_data_section
from msnn.features.data_check.sampling import follows
from msnn.model.model import Model
from msnn.model.model_data import data_folder, plain_layout, sources_of, told_where_they_were
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.sections.data import Data
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


# `nan: split` cuts at missing values in place of refusing them; without `split` all is one set
_KEPT: Mapping[str, str | None] = {"nan": "split", "split": None}
"""Overrides of the data section: nothing is refused, and all rows are in one set."""


def read_as_recorded(
    model: Model, files: Sequence[Path] | None, data_root: str | Path | None
) -> Mapping[str, Dataset]:
    """Every data section of the spec: `data`, then the files of entries of `validate`.

    `files` replace all of them, with the layout of `data`. Raises SpecError for invalid files, such
    as text among numbers.
    """
    sections: dict[str, Data] = {}
    if model.spec.data is not None:
        sections["data"] = model.spec.data
        if files:
            sections["data"] = data_of_files(model.spec.data, files)
    if not files:
        sections |= file_sections(model.spec)
    if not sections:
        raise SpecError([no_data_section("a check of data")])
    # diagnostics show lines of the spec and of data files
    with sources_of(model), told_where_they_were(model, data_root):
        return {
            name: _read(model, section, data_root, as_recorded=True)
            for name, section in sections.items()
        }


def read_resampled(
    model: Model, files: Sequence[Path] | None, data_root: str | Path | None
) -> Dataset | None:
    """The section `data` at the sample time; None where the spec resamples nothing."""
    section = model.spec.data
    if section is None or not _resamples(section):
        return None
    if files:
        section = data_of_files(section, files)
    with sources_of(model):
        return _read(model, section, data_root, as_recorded=False)


def frames_as_recorded(model: Model, frames: Frames) -> Dataset:
    """The recordings in frames, with the layout of the section `data`, if there is one."""
    return _framed(model, model.spec.data or plain_layout(model), frames, as_recorded=True)


def frames_resampled(model: Model, frames: Frames) -> Dataset | None:
    """The same at the sample time; None where the spec resamples nothing."""
    section = model.spec.data
    if section is None or not _resamples(section):
        return None
    return _framed(model, section, frames, as_recorded=False)


def _framed(model: Model, section: Data, frames: Frames, *, as_recorded: bool) -> Dataset:
    section = section.model_copy(update=_KEPT)
    filters = row_filters(model.spec.model_copy(update={"data": section}))
    with sources_of(model):
        return frame_data(
            model.program,
            section,
            frames,
            model.spec.place,
            filters,
            split=False,
            as_recorded=as_recorded,
        )


def _read(
    model: Model, section: Data, data_root: str | Path | None, *, as_recorded: bool
) -> Dataset:
    section = section.model_copy(update=_KEPT)
    filters = row_filters(model.spec.model_copy(update={"data": section}))
    folder = data_folder(model, data_root)
    return load_data(
        model.program,
        section,
        folder,
        filters,
        as_recorded=as_recorded,
        recorded=model.recorded,
    )


def _resamples(data: Data) -> bool:
    layouts = (data, *data.source.values())
    return any(layout.resample in ("linear", "nearest") for layout in layouts)
