"""Chooses the columns that feed each signal, and converts their numbers to the signal's."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir.program import Role, Signal
from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey
from msnn.errors.data import files as errors
from msnn.errors.data import units as data_units
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.sections.data.columns import Column
from spec_schema.units.unit import Unit

LOG_SUFFIX = ".meas"


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """A signal's columns, one an element in C order; value = factor · cell + offset."""

    signal: Signal
    keys: tuple[ColumnKey, ...]
    factor: float | FloatArray
    """One for all columns, or one for each."""
    offset: float | FloatArray
    column: Column | None = None
    """What the spec says of them."""

    def series(self, columns: Mapping[ColumnKey, FloatArray]) -> FloatArray:
        """(rows, *shape) in the signal's unit."""
        cells = np.stack([columns[key] for key in self.keys], axis=1)
        values = cells * self.factor + self.offset
        return values.reshape(len(cells), *(axis.size for axis in self.signal.axes))

    def series_if_there(self, columns: Mapping[ColumnKey, FloatArray], rows: int) -> FloatArray:
        """The series; missing values where the file has not all of its columns."""
        if all(key in columns for key in self.keys):
            return self.series(columns)
        return np.full((rows, *(axis.size for axis in self.signal.axes)), np.nan)


def feeds(
    signals: Iterable[Signal], columns: Mapping[str, Column], findings: Findings
) -> list[Feed]:
    """The feed of every signal; a signal without an entry has the column of its own name."""
    found: list[Feed] = []
    for signal in signals:
        name = signal.name.removesuffix(LOG_SUFFIX)
        # `x.meas` of a state may have an entry of its own, else it is that of x
        column = columns.get(signal.name, columns.get(name))
        size = math.prod(axis.size for axis in signal.axes)
        keys: tuple[ColumnKey, ...] = (name,)
        factor, offset, span = 1.0, 0.0, signal.span
        if column is not None:
            keys = tuple(part.column for part in column.column)
            span = column.place.value
            factor, offset = _conversion(signal, column, findings)
        if len(keys) != size:
            findings.report(errors.wrong_column_count(signal.name, len(keys), size, span))
        else:
            found.append(
                Feed(signal=signal, keys=keys, factor=factor, offset=offset, column=column)
            )
    return found


def in_units_of_file(
    found: Iterable[Feed], units: Mapping[ColumnKey, Unit], findings: Findings
) -> list[Feed]:
    """Feeds that convert from what the file says of its columns, where the spec says no unit."""
    return [_in_units(feed, units, findings) for feed in found]


def _in_units(feed: Feed, units: Mapping[ColumnKey, Unit], findings: Findings) -> Feed:
    declared, column = feed.signal.unit, feed.column
    stated = {key: units[key] for key in feed.keys if key in units}
    # what the spec says goes before what a file says
    if declared is None or not stated or (column is not None and column.unit is not None):
        return feed
    if all(unit.same_as(declared) for unit in stated.values()):
        return feed
    span = feed.signal.span if column is None else column.place.value
    scaled = column is not None and (column.scale != 1.0 or column.offset != 0.0)
    for key, unit in stated.items():
        # `scale:` may convert already: with a unit of the file beside it, cells would convert twice
        fits = unit.same_dimension(declared)
        if not fits or (scaled and not unit.same_as(declared)):
            make = data_units.unit_beside_scale if fits else data_units.misfitting_file_unit
            name = feed.signal.name.removesuffix(LOG_SUFFIX)
            findings.report(
                make(
                    signal=name,
                    column=str(key),
                    found=unit.text,
                    declared=declared.text,
                    span=span,
                )
            )
            return feed
    pairs = [_to_signal(stated.get(key, declared), declared) for key in feed.keys]
    factors, offsets = (np.array(each) for each in zip(*pairs, strict=True))
    return replace(feed, factor=factors, offset=offsets)


def _to_signal(unit: Unit, declared: Unit) -> tuple[float, float]:
    """Factor and offset from one unit to another."""
    if unit.same_as(declared):
        return 1.0, 0.0
    # affine, as °C to K: the offset is what 0 becomes
    return unit.factor_to(declared), unit.convert(0.0, declared)


def wanted_columns(found: Iterable[Feed]) -> dict[ColumnKey, str]:
    """Every column that is read, with the signal that it is read for."""
    wanted: dict[ColumnKey, str] = {}
    for feed in found:
        for key in feed.keys:
            wanted.setdefault(key, f"`{feed.signal.name}`")
    return wanted


def target_columns(found: Iterable[Feed]) -> frozenset[ColumnKey]:
    """Columns that feed targets only: their values may be missing."""
    needed = {key for feed in found if feed.signal.role is Role.INPUT for key in feed.keys}
    return frozenset(key for feed in found for key in feed.keys if key not in needed)


def _conversion(signal: Signal, column: Column, findings: Findings) -> tuple[float, float]:
    """Factor and offset from cells to the signal's unit (the only place where units convert)."""
    declared: Unit | None = signal.unit
    if column.unit is None or declared is None:
        return column.scale, column.offset
    unit = column.unit.value
    if not unit.same_dimension(declared):
        findings.report(
            errors.inconvertible_column(signal.name, unit.text, declared.text, column.unit.span)
        )
        return column.scale, column.offset
    factor, shift = _to_signal(unit, declared)
    # the spec's scale and offset make a value in the column's unit, which is converted then
    return factor * column.scale, factor * column.offset + shift
