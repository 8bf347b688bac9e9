"""Selects the columns of each signal, and converts their values to the signal's unit."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import TypeAlias

import numpy as np

from compiler.ir.program import Signal
from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnKey
from msnn.data.formats.written_units import (
    CapitalUnit,
    MixedUnits,
    StatedUnit,
    TwoUnits,
    UnknownUnit,
)
from msnn.errors.data import cells as data_units
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.sections.data import Column
from spec_schema.units.parser import confused_units, parse_unit
from spec_schema.units.quantity import turn_readings
from spec_schema.units.unit import DIGITS, UNCHANGED, Line, Unit, nearest_float

LOG_SUFFIX = ".meas"


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """A signal's columns, one per element in C order, and their conversions to the signal's
    unit.
    """

    signal: Signal
    keys: tuple[ColumnKey, ...]
    lines: tuple[Line, ...]
    """The conversion of each column."""
    column: Column | None = None
    """The entry of the spec for these columns."""

    def series(self, columns: Mapping[ColumnKey, FloatArray]) -> FloatArray:
        """(rows, *shape) in the signal's unit."""
        fed = zip(self.keys, self.lines, strict=True)
        values = np.stack([converted_cells(columns[key], line) for key, line in fed], axis=1)
        return values.reshape(len(values), *(axis.size for axis in self.signal.axes))

    def series_if_there(self, columns: Mapping[ColumnKey, FloatArray], rows: int) -> FloatArray:
        """The series, filled with NaN if the file lacks one of its columns."""
        if all(key in columns for key in self.keys):
            return self.series(columns)
        return np.full((rows, *(axis.size for axis in self.signal.axes)), np.nan)


def feeds(
    signals: Iterable[Signal], columns: Mapping[str, Column], findings: Findings
) -> list[Feed]:
    """The columns of every signal with their unit conversions, as one `Feed` per signal.

    A signal without an entry in `columns` has one column, with its own name. The log `x.meas` of a
    state has its own entry, otherwise that of x. Reports and omits a signal whose number of columns
    is not its number of elements.
    """
    found: list[Feed] = []
    for signal in signals:
        name = signal.name.removesuffix(LOG_SUFFIX)
        # `x.meas` of a state may have an entry of its own, else it is that of x
        column = columns.get(signal.name, columns.get(name))
        size = math.prod(axis.size for axis in signal.axes)
        keys: tuple[ColumnKey, ...] = (name,)
        line, span = UNCHANGED, signal.span
        if column is not None:
            keys = tuple(part.column for part in column.column)
            span = column.place.value
            line = _conversion(signal, column, findings)
        if len(keys) != size:
            findings.report(errors.wrong_column_count(signal.name, len(keys), size, span))
        else:
            lines = (line,) * len(keys)
            found.append(Feed(signal=signal, keys=keys, lines=lines, column=column))
    return found


def in_units_of_file(
    found: Iterable[Feed], units: Mapping[ColumnKey, StatedUnit], file: str, findings: Findings
) -> list[Feed]:
    """Feeds that convert from the units stated in the file, unless the spec states a unit."""
    return [_in_units(feed, units, file, findings) for feed in found]


def report_scaled_twice(
    found: Iterable[Feed], packed: Mapping[ColumnKey, str], findings: Findings
) -> None:
    """Reports columns scaled by the file and by the spec: both may state the same factor."""
    for feed in found:
        column = feed.column
        if column is None or (column.scale == 1.0 and column.offset == 0.0):
            continue
        for key in feed.keys:
            if key in packed:
                name, span = feed.signal.name.removesuffix(LOG_SUFFIX), column.place.value
                findings.report(data_units.scaled_twice(name, str(key), packed[key], span))


def _in_units(
    feed: Feed, units: Mapping[ColumnKey, StatedUnit], file: str, findings: Findings
) -> Feed:
    declared, column = feed.signal.unit, feed.column
    # units in the spec take precedence over units in the file
    if declared is None or (column is not None and column.unit is not None):
        return feed
    span = feed.signal.span if column is None else column.place.value
    scaled = column is not None and (column.scale != 1.0 or column.offset != 0.0)
    name = feed.signal.name.removesuffix(LOG_SUFFIX)
    lines: list[Line] = []
    for key, line in zip(feed.keys, feed.lines, strict=True):
        unit = file_unit(units.get(key), file, name, str(key), declared, span, findings)
        fault = None if unit is None else _unfit_unit(name, str(key), unit, declared, span)
        if unit is None or (fault is None and unit.same_as(declared)):
            lines.append(line)
            continue
        # `scale:` may convert already: with a unit of the file beside it, cells would convert twice
        if fault is None and scaled:
            fault = data_units.unit_beside_scale(
                signal=name, column=str(key), found=unit.text, declared=declared.text, span=span
            )
        if fault is not None:
            findings.report(fault)
            return feed
        lines.append(unit.line_to(declared))
    return replace(feed, lines=tuple(lines))


def file_unit(
    stated: StatedUnit | None,
    file: str,
    signal: str,
    column: str,
    declared: Unit,
    span: Span | None,
    findings: Findings,
) -> Unit | None:
    """The unit that a file states for a column; None, with a report, if it is unclear."""
    match stated:
        case UnknownUnit(text=text, meant=meant, scale=scale):
            # a similar unit of another dimension is not suggested
            if meant is not None and not parse_unit(meant).converts_to(declared):
                meant, scale = None, 1.0
            findings.report(
                data_units.unread_unit(
                    signal=signal,
                    column=column,
                    text=text,
                    declared=declared.text,
                    meant=meant,
                    scale=scale,
                    span=span,
                )
            )
            return None
        case TwoUnits(named=named, stated=other, place=place):
            findings.report(
                data_units.units_differ(
                    file=file,
                    signal=signal,
                    column=column,
                    named=named.text,
                    stated=other.text,
                    place=place or span,
                )
            )
            return None
        case MixedUnits(shown=shown):
            cells = [(one.unit and one.unit.text, one.cell, one.count) for one in shown]
            findings.report(
                data_units.mixed_cells(
                    file=file,
                    signal=signal,
                    column=column,
                    cells=cells,
                    declared=declared.text,
                    span=span,
                )
            )
            return None
        case CapitalUnit():
            fitting = stated.fitting(declared)
            if len(fitting) > 1:
                readings = tuple(unit.text for unit in fitting)
                findings.report(
                    data_units.doubtful_capitals(
                        signal=signal,
                        column=column,
                        text=stated.text,
                        readings=readings,
                        span=span,
                    )
                )
                return None
            return fitting[0] if fitting else stated.likely
        case _:
            return stated


def _unfit_unit(
    signal: str, column: str, unit: Unit, declared: Unit, span: Span | None
) -> Diagnostic | None:
    """The diagnostic for a unit that does not fit the signal's unit; None if it converts."""
    if not unit.converts_to(declared):
        return misfit(signal, column, unit, declared, span)
    return _turns_fault(signal, column, unit, declared, span)


def misfit(signal: str, column: str, unit: Unit, declared: Unit, span: Span | None) -> Diagnostic:
    """Diagnostic E0999, with the unit that was probably intended."""
    return data_units.misfitting_file_unit(
        signal=signal,
        column=column,
        found=unit.text,
        declared=declared.text,
        meant=_meant(unit, declared),
        span=span,
    )


def _meant(unit: Unit, declared: Unit) -> str | None:
    """A unit that is often confused with `unit` and converts to the signal's unit, if there is
    one.
    """
    found = (other for other in confused_units(unit) if other.converts_to(declared))
    return next((other.text for other in found), None)


def _turns_fault(
    signal: str, column: str, unit: Unit, declared: Unit, span: Span | None
) -> Diagnostic | None:
    readings = turn_readings(unit, declared)
    if readings is None:
        return None
    return data_units.turns_of_column(
        signal=signal,
        column=column,
        found=unit.text,
        declared=declared.text,
        readings=readings.texts,
        span=span,
    )


def wanted_columns(found: Iterable[Feed]) -> dict[ColumnKey, str]:
    """Every column to read, with the signal that needs it."""
    wanted: dict[ColumnKey, str] = {}
    for feed in found:
        for key in feed.keys:
            wanted.setdefault(key, f"`{feed.signal.name}`")
    return wanted


def columns_of_only(found: Iterable[Feed], names: Collection[str]) -> frozenset[ColumnKey]:
    """The columns that feed only these signals."""
    found = tuple(found)
    needed = {key for feed in found if feed.signal.name not in names for key in feed.keys}
    return frozenset(key for feed in found for key in feed.keys if key not in needed)


def _conversion(signal: Signal, column: Column, findings: Findings) -> Line:
    """From cells to the signal's unit. Units are converted only here."""
    declared: Unit | None = signal.unit
    line = UNCHANGED
    if column.unit is not None and declared is None:
        text = column.unit.value.text
        findings.report(data_units.unit_without_effect(signal.name, text, column.unit.span))
    if column.unit is not None and declared is not None:
        unit = column.unit.value
        key = str(column.column[0].column)
        if (fault := _turns_fault(signal.name, key, unit, declared, column.unit.span)) is not None:
            findings.report(fault)
        elif unit.converts_to(declared):
            line = unit.line_to(declared)
        else:
            meant = _meant(unit, declared)
            findings.report(
                errors.inconvertible_column(
                    signal.name, unit.text, declared.text, meant, column.unit.span
                )
            )
    # the spec's scale and offset make a value in the column's unit, which is converted then
    return line.after(column.scale, column.offset)


_REACH = 280
"""Decimal exponents within which no intermediate result overflows or underflows."""
_SPLIT = float(2**27 + 1)
_AT_ONCE = 1 << 14
"""Cells per block: intermediate results stay in the cache, which takes a fifth of the time."""

_Pair: TypeAlias = tuple[float, float]
"""The float nearest to a number, and the difference from the number."""


def converted_cells(cells: FloatArray, line: Line) -> FloatArray:
    """factor · cell + summand, with the cell as the decimal number that was written.

    3 mm must become 0.003 m, as in a spec, but 9 · 0.001 is 0.009000000000000001. Sums and products
    use pairs of floats (Dekker, Numer. Math. 18, 1971), so that only the result is rounded.
    Decibels are 20 log10 of a ratio: NaN if it is negative.
    """
    if line == UNCHANGED:
        return cells
    factor, summand = _pair(line.factor), _pair(line.summand)
    found = np.empty(len(cells))
    # infinities, differences below the smallest float, and logarithms of negative values
    with np.errstate(all="ignore"):
        for begin in range(0, len(cells), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            found[some] = _on_line(cells[some], factor, summand)
        match line.level:
            case "to":
                return 20.0 * np.log10(found)
            case "from":
                return float(line.ratio) * 10.0 ** (found / 20.0)
            case None:
                return found


def _on_line(cells: FloatArray, factor: _Pair, summand: _Pair) -> FloatArray:
    product = cells * factor[0]
    rest = _product_rest(cells, factor[0], product)
    rest += _decimal_rest(cells) * factor[0] + cells * factor[1]
    total = product + summand[0]
    there = total - product
    rest += (product - (total - there)) + (summand[0] - there) + summand[1]
    found = total + rest
    return np.where(np.isfinite(found), found, total)


def _decimal_rest(cells: FloatArray) -> FloatArray:
    """The difference between the decimal number that was written and the cell; 0 if unknown."""
    size = np.abs(cells)
    inside = (size > 10.0**-_REACH) & (size < 10.0**_REACH)
    at = DIGITS - 1 - np.floor(np.log10(np.where(inside, size, 1.0))).astype(np.int64)
    powers, inverses, inverse_rests = _powers_of_ten()
    # the logarithm of a number beside a power of ten may be rounded to that of the power
    first = size * powers[at + _REACH + DIGITS]
    at += (first < 10.0 ** (DIGITS - 1)).astype(np.int64) - (first >= 10.0**DIGITS)
    at += _REACH + DIGITS
    digits = np.rint(cells * powers[at])
    nearest = digits * inverses[at]
    rest = _product_rest(digits, inverses[at], nearest) + digits * inverse_rests[at]
    rest += nearest - cells
    is_meant = inside & (np.abs(rest) <= np.spacing(size) / 2)
    return np.where(is_meant, rest, 0.0)


def _product_rest(left: FloatArray, right: FloatArray | float, product: FloatArray) -> FloatArray:
    """The rounding error of a product."""
    left_high = left * _SPLIT - (left * _SPLIT - left)
    right_high = right * _SPLIT - (right * _SPLIT - right)
    left_low, right_low = left - left_high, right - right_high
    most = (left_high * right_high - product) + left_high * right_low + left_low * right_high
    return np.asarray(most + left_low * right_low, np.float64)


@cache
def _powers_of_ten() -> tuple[FloatArray, FloatArray, FloatArray]:
    """10ᵏ as floats, and 10⁻ᵏ as pairs, for k ≥ -_REACH - DIGITS."""
    span = range(-_REACH - DIGITS, _REACH + DIGITS + 1)
    inverses = np.array([_pair(Fraction(10) ** -k) for k in span])
    return np.array([float(f"1e{k}") for k in span]), inverses[:, 0], inverses[:, 1]


def _pair(number: Fraction) -> _Pair:
    nearest = nearest_float(number)
    return nearest, float(number - Fraction(nearest)) if math.isfinite(nearest) else 0.0
