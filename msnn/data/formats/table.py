"""Columns read from one file, in any format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from msnn.data.dataset import FloatArray
from msnn.data.formats.written_units import StatedUnit
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment
from spec_schema.fields.leaf import Located
from spec_schema.units.unit import Unit

ColumnKey = str | int
"""A column's name, or its index counted from 0."""


def _no_place(row: int) -> Span | None:
    """None: rows of a binary file have no line that a message could show."""
    del row


def _no_cell(row: int, key: ColumnKey) -> tuple[str, Span | None]:
    """The text of a missing value in a binary file, without a place."""
    del row, key
    return "NaN", None


@dataclass(frozen=True, slots=True)
class TimeSource:
    """The time column named in the spec, where it is named, and its unit if the spec gives one."""

    column: ColumnKey
    place: Span
    unit: Located[Unit] | None = None


@dataclass(frozen=True, slots=True)
class WantedColumns:
    """The columns to read from a file; `users` names for each column what needs it, for
    messages.
    """

    users: Mapping[ColumnKey, str]
    optional: frozenset[ColumnKey] = frozenset()
    """Columns that may have missing values."""
    spare: frozenset[ColumnKey] = frozenset()
    """Columns that the file may lack."""
    moments: frozenset[ColumnKey] = frozenset()
    """Time columns, which may contain dates instead of numbers."""
    missing: Mapping[ColumnKey, frozenset[str]] = field(
        default_factory=dict[ColumnKey, frozenset[str]]
    )
    """Lower-case texts of cells that mean a missing value, besides those of every file."""
    time_format: str | None = None
    """How the cells of `moments` are written; None for ISO 8601 or numbers."""
    time: TimeSource | None = None
    """The time source of a file with several clocks; None for the file's default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnTable:
    """Columns of equal length; row 0 is the first."""

    columns: Mapping[ColumnKey, FloatArray]
    time: FloatArray | None = None
    """Time of each row in seconds, if the format stores it."""
    time_begins: Moment | None = None
    """The date of time 0, if the format stores it."""
    place: Callable[[int], Span | None] = _no_place
    """The place of a row in the file, for messages."""
    cell: Callable[[int, ColumnKey], tuple[str, Span | None]] = _no_cell
    """The text of the cell in a row and column, and its place."""
    units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """Units that the file states for columns."""
    packed: Mapping[ColumnKey, str] = field(default_factory=dict[ColumnKey, str])
    """Scaling that was applied when columns were unpacked: `scale_factor 0.1`."""
    begins: Mapping[ColumnKey, Moment] = field(default_factory=dict[ColumnKey, Moment])
    """The date of the first row, for date columns; their values are seconds since that row."""
    warnings: tuple[Diagnostic, ...] = ()
    """Warnings about the file as a whole."""

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True, slots=True)
class Streams:
    """Columns with their own timestamps: (seconds, values)."""

    columns: Mapping[ColumnKey, tuple[FloatArray, FloatArray]]
    units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """Units that the file states for columns."""
    time_units: Mapping[ColumnKey, StatedUnit] = field(default_factory=dict[ColumnKey, StatedUnit])
    """Units of times taken from channels, if the file states them; other times are in seconds."""
    packed: Mapping[ColumnKey, str] = field(default_factory=dict[ColumnKey, str])
    """Scaling that was applied when columns were unpacked, for messages."""
    begins: Moment | None = None
    """The date of time 0, if the file stores it."""
    warnings: tuple[Diagnostic, ...] = ()
    """Warnings about the file as a whole."""
