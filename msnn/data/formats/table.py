"""Columns read from one file, whatever its format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from msnn.data.dataset import FloatArray
from msnn.data.formats.written_units import StatedUnit
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment
from spec_schema.fields.located import Located
from spec_schema.units.unit import Unit

ColumnKey = str | int
"""A column's name, or its index counted from 0."""


def _no_place(row: int) -> Span | None:
    """Rows of a binary file stand nowhere that a message could show."""
    del row


def _no_cell(row: int, key: ColumnKey) -> tuple[str, Span | None]:
    """Numbers of a binary file have no text but this where they are missing."""
    del row, key
    return "NaN", None


@dataclass(frozen=True, slots=True)
class TimeSource:
    """The column of times that the spec names, where it is named, and the unit given there."""

    column: ColumnKey
    place: Span
    unit: Located[Unit] | None = None


@dataclass(frozen=True, slots=True)
class WantedColumns:
    """The columns to read of a file; `users` names for each column what wants it, for messages."""

    users: Mapping[ColumnKey, str]
    optional: frozenset[ColumnKey] = frozenset()
    """Columns in which values may be missing."""
    spare: frozenset[ColumnKey] = frozenset()
    """Columns that a file need not have."""
    moments: frozenset[ColumnKey] = frozenset()
    """Columns of time, which may have dates in place of numbers."""
    time: TimeSource | None = None
    """The times of values in a file that keeps several; None for those it keeps by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnTable:
    """Columns of equal length; row 0 is the first."""

    columns: Mapping[ColumnKey, FloatArray]
    time: FloatArray | None = None
    """Seconds of each row, where the format keeps them itself."""
    time_begins: Moment | None = None
    """The moment of their time 0, where the format keeps it."""
    place: Callable[[int], Span | None] = _no_place
    """Where a row stands in the file."""
    cell: Callable[[int, ColumnKey], tuple[str, Span | None]] = _no_cell
    """The text of the cell in a row and column, and where it stands."""
    units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """What the file itself says of columns."""
    packed: Mapping[ColumnKey, str] = field(default_factory=dict[ColumnKey, str])
    """How the file scales the numbers of columns, which are unpacked: `scale_factor 0.1`."""
    begins: Mapping[ColumnKey, Moment] = field(default_factory=dict[ColumnKey, Moment])
    """Of columns of dates, which are seconds from their first row: the moment of that row."""

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True, slots=True)
class Streams:
    """Columns that were each recorded at moments of their own: (seconds, values)."""

    columns: Mapping[ColumnKey, tuple[FloatArray, FloatArray]]
    units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """What the file itself says of columns."""
    time_units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """Units of times that are values of the file, as far as it states them; others are seconds."""
    begins: Moment | None = None
    """The moment of time 0, where the file keeps it."""
