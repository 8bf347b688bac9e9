"""Extracts columns of numbers and dates from named arrays: MAT, HDF5, NPZ, Parquet, frames."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_attributes import PackingError, UnitTexts, scaling, unpacked
from msnn.data.formats.table import ColumnKey, ColumnTable, WantedColumns
from msnn.data.formats.written_units import (
    MISSING,
    CapitalUnit,
    StatedUnit,
    column_and_unit,
    joint_unit,
    one_unit,
    stated_unit,
    with_case,
)
from msnn.errors.data import cells as cell_errors
from msnn.errors.data import cells as data_units
from msnn.errors.data import files as errors
from msnn.errors.data import rows as data_formats
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.expressions.moments import FARTHEST, Moment, read_moment
from spec_schema.expressions.time_format import TimeFormat, written_format

_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>[0-9]{1,9})\]")


def _no_texts(name: str) -> UnitTexts:
    del name
    return ()


def _no_packing(name: str) -> Mapping[str, Any]:
    del name
    return {}


@dataclass(frozen=True, slots=True)
class NamedArrays:
    """The arrays of one file: their names, in the file's order, and a function that reads one."""

    file: str
    names: Sequence[str]
    get: Callable[[str], NDArray[Any]]
    zoned: frozenset[str] = frozenset()
    """Names of date arrays in UTC; numpy's dates have no time zone."""
    unit_texts: Callable[[str], UnitTexts] = _no_texts
    """Units that the file states for an array, apart from the array's name."""
    packing: Callable[[str], Mapping[str, Any]] = _no_packing
    """The attributes for unpacking an array, such as `scale_factor`."""
    applied: str = ""
    """The scaling that `get` has applied, for messages."""
    other_names: Sequence[str] = ()
    other_units: Callable[[], Sequence[str]] = tuple
    """Names and units of the file's other arrays, which show if the file uses lower-case
    letters.
    """

    def table(self, wanted: WantedColumns) -> ColumnTable:
        """The requested columns, each (rows,).

        A one-dimensional array is a column with its own name. `name[2]` is the third column of a
        two-dimensional array, whose rows are samples. `F` also matches `F [kN]`. Raises SpecError
        with all errors of the file.
        """
        faults: list[Diagnostic] = []
        missing: dict[str, str] = {}
        columns: dict[ColumnKey, FloatArray] = {}
        units: dict[ColumnKey, StatedUnit] = {}
        packed: dict[ColumnKey, str] = {}
        begins: dict[ColumnKey, Moment] = {}
        for key, user in wanted.users.items():
            name, index = self._split(key)
            if name is None:
                if self._is_double(key):
                    repair = "choose one by its index, counted from 0"
                    faults.append(errors.duplicate_column(str(key), self.file, None, repair))
                # optional signals may have no column at all
                elif key not in wanted.spare:
                    missing[str(key)] = user
                continue
            if self.names.count(name) > 1:
                repair = "give each column a name of its own"
                faults.append(errors.duplicate_column(name, self.file, None, repair))
                continue
            if (unit := self._unit(name, index)) is not None:
                units[key] = unit
            try:
                packing = self.packing(name)
                array = unpacked(_without_marked(self.get(name), wanted.missing.get(key)), packing)
                if text := self.applied or scaling(packing):
                    packed[key] = text
            except PackingError as error:
                faults.append(data_formats.unusable_array(str(key), self.file, user, str(error)))
                continue
            # only of columns of time: a date in a column of numbers is a fault like any text
            if key in wanted.moments and wanted.time_format is not None:
                if array.ndim != 1 or array.dtype.kind not in "OSUT":
                    kind = "dates" if array.dtype.kind == "M" else "numbers"
                    faults.append(
                        data_units.other_kind_of_times("format", str(key), self.file, kind, None)
                    )
                    continue
                dates = _of_format(array, self.file, str(key), written_format(wanted.time_format))
                columns[key] = dates.seconds
                faults += dates.faults
                if dates.begins is not None:
                    begins[key] = dates.begins
                continue
            if key in wanted.moments and has_dates(array):
                dates = dates_of(array, self.file, str(key), is_utc=name in self.zoned)
                columns[key] = dates.seconds
                faults += dates.faults
                if dates.begins is not None:
                    begins[key] = dates.begins
                continue
            column, reason = _column(array, index)
            if column is None:
                faults.append(data_formats.unusable_array(str(key), self.file, user, reason))
                continue
            columns[key] = column
            may_miss, is_time = key in wanted.optional, key in wanted.moments
            faults += value_faults(self.file, key, column, may_miss=may_miss, is_time=is_time)
        if missing:
            faults.append(
                errors.missing_columns(missing, self.file, self.names, None, numbers=False)
            )
        if not faults:
            faults += length_faults(self.file, columns)
        if faults:
            raise SpecError(faults)
        return ColumnTable(columns=columns, units=units, packed=packed, begins=begins)

    def has(self, key: ColumnKey) -> bool:
        """True if there is an array for a column."""
        return self._split(key)[0] is not None

    def _split(self, key: ColumnKey) -> tuple[str | None, int | None]:
        if isinstance(key, int):
            return (self.names[key] if key < len(self.names) else None), None
        if key in self.names:
            return key, None
        found = _ELEMENT.fullmatch(key)
        if found is not None and found["name"] in self.names:
            return found["name"], int(found["index"])
        alike = self._before_units(key)
        return (alike[0] if len(alike) == 1 else None), None

    def _unit(self, name: str, index: int | None) -> StatedUnit | None:
        stated: StatedUnit | None = None
        for texts in self.unit_texts(name):
            at = 0 if len(texts) == 1 else index
            text = texts[at] if at is not None and at < len(texts) else ""
            stated = one_unit(stated, stated_unit(text))
        unit = joint_unit(name, stated)
        if not isinstance(unit, CapitalUnit):
            return unit
        # only for a unit in doubt: of all columns they are many
        others = [t for other in self.names for texts in self.unit_texts(other) for t in texts]
        return with_case(unit, (*self.names, *self.other_names), (*others, *self.other_units()))

    def _before_units(self, key: ColumnKey) -> list[str]:
        """The array names that consist of the key and a unit, such as `F [kN]` for `F`."""
        return [name for name in self.names if column_and_unit(name)[0] == key]

    def _is_double(self, key: ColumnKey) -> bool:
        return len(self._before_units(key)) > 1


def length_faults(file: str, columns: Mapping[ColumnKey, FloatArray]) -> list[Diagnostic]:
    """Reports columns whose lengths differ although they should be rows of one table."""
    # arrays of a file form one table only if they have equal lengths
    lengths = {str(key): len(column) for key, column in columns.items()}
    if len(set(lengths.values())) > 1:
        return [data_formats.unequal_columns(file, lengths)]
    if not next(iter(lengths.values()), 1):
        return [errors.empty_file(file, header=True)]
    return []


def value_faults(
    file: str, key: ColumnKey, column: FloatArray, *, may_miss: bool, is_time: bool = False
) -> list[Diagnostic]:
    """Diagnostics for infinite values, and for missing values unless `may_miss`."""
    faults: list[Diagnostic] = []
    missing, infinite = np.isnan(column), np.isinf(column)
    if missing.any() and not may_miss:
        row, more = int(np.argmax(missing)), int(missing.sum()) - 1
        missed = cell_errors.missing_value(
            file,
            row,
            str(key),
            "NaN",
            more,
            None,
            is_time=is_time,
        )
        faults.append(missed)
    if infinite.any():
        row, more = int(np.argmax(infinite)), int(infinite.sum()) - 1
        faults.append(cell_errors.infinite_value(file, row, str(key), "inf", more, None))
    return faults


def _without_marked(array: NDArray[Any], marks: frozenset[str] | None) -> NDArray[Any]:
    """The array of objects with NaN for texts that mark a missing value, if all others are
    numbers.
    """
    if not marks or array.dtype.kind != "O" or array.ndim != 1:
        return array
    texts = [isinstance(cell, str) and cell.strip().lower() in marks for cell in array]
    cells = [np.nan if marked else cell for cell, marked in zip(array, texts, strict=True)]
    is_numeric = all(isinstance(cell, int | float | np.number) for cell in cells)
    return np.array(cells, np.float64) if is_numeric else array


def _column(array: NDArray[Any], index: int | None) -> tuple[FloatArray | None, str]:
    """One column as float64, or None with the reason. Dates and durations become seconds."""
    if array.dtype.kind == "M":
        # from the earliest on: nanoseconds since 1970 have more digits than a float64
        array = (array - array.min(initial=array[0])) / np.timedelta64(1, "ns") * 1e-9
    elif array.dtype.kind == "m":
        array = array / np.timedelta64(1, "ns") * 1e-9
    # b: True is 1. Complex numbers, texts and objects are none
    if array.dtype.kind not in "biuf":
        if array.dtype.kind == "O":
            return None, "it holds objects: `np.asarray(…, float)` makes numbers, and NaN of None"
        return None, "it does not hold real numbers"
    # MAT files have vectors as matrices of one row or column
    if array.ndim == 2 and index is None and 1 in array.shape:
        array = array.ravel()
    if index is not None:
        if array.ndim != 2 or index >= array.shape[1]:
            return None, f"its shape {array.shape} has no column {index}"
        array = array[:, index]
    if array.ndim == 2:
        return None, f"it has {array.shape[1]} columns; choose one with `[0]`, `[1]`, …"
    if array.ndim != 1:
        return None, f"its shape {array.shape} is no column"
    return np.ascontiguousarray(array, np.float64), ""


_MISSING = MISSING | {"nat", "none", "<na>"}
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
"""Ticks per second of datetime64; coarser units are read as seconds, finer ones as nanoseconds."""


@dataclass(frozen=True, slots=True)
class Dates:
    """Seconds since the first date, the first date, and diagnostics for invalid dates."""

    seconds: FloatArray
    begins: Moment | None
    faults: tuple[Diagnostic, ...] = ()


def has_dates(array: NDArray[Any]) -> bool:
    """True for a datetime64 array, or if the first element is the text of a date."""
    if array.ndim != 1:
        return False
    if array.dtype.kind == "M":
        return True
    return array.dtype.kind in "OUT" and len(array) > 0 and read_moment(str(array[0])) is not None


def dates_of(array: NDArray[Any], file: str, column: str, *, is_utc: bool) -> Dates:
    """The dates of an array for which `has_dates` is true; `is_utc` gives datetime64 a time zone.

    Other objects are parsed from their text, such as a pandas Timestamp with its UTC offset.
    """
    if array.dtype.kind == "M":
        return _of_numpy(array, file, column, is_utc=is_utc)
    moments = [read_moment(str(cell)) for cell in array]
    first = moments[0]
    assert first is not None, "has_dates has seen it"
    no_dates = [row for row, moment in enumerate(moments) if moment is None]
    absent = [row for row in no_dates if str(array[row]).lower() in _MISSING]
    # markers for missing values and invalid dates are reported separately: the repairs differ
    others = [row for row in no_dates if row not in set(absent)]
    of_another_clock = [
        row
        for row, moment in enumerate(moments)
        if moment is not None and moment.has_zone != first.has_zone
    ]
    faults = tuple(
        make(file, rows[0], column, str(array[rows[0]]), len(rows) - 1, None)
        for make, rows in (
            (partial(cell_errors.missing_value, is_time=True), absent),
            (data_units.not_a_moment, others),
            (data_units.mixed_zones, of_another_clock),
        )
        if rows
    )
    seconds = np.array(
        [np.nan if moment is None else moment.nanoseconds - first.nanoseconds for moment in moments]
    )
    return Dates(seconds / 1e9, first, faults)


def _of_format(array: NDArray[Any], file: str, column: str, format: TimeFormat) -> Dates:
    """The dates of texts in a format of the spec."""
    # texts of HDF5 files are bytes
    texts = [c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c) for c in array]
    moments = [format.moment(text.strip()) for text in texts]
    wrong = [row for row, moment in enumerate(moments) if moment is None]
    absent = [row for row in wrong if texts[row].strip().lower() in _MISSING]
    others = [row for row in wrong if row not in set(absent)]
    misfit = partial(data_units.unlike_format, wanted=format.text)
    faults = tuple(
        make(file, rows[0], column, texts[rows[0]], len(rows) - 1, None)
        for make, rows in (
            (partial(cell_errors.missing_value, is_time=True), absent),
            (misfit, others),
        )
        if rows
    )
    known = [moment for moment in moments if moment is not None]
    if faults or not known:
        return Dates(np.full(len(array), np.nan), None, faults)
    nanoseconds = np.array([moment.nanoseconds for moment in known], np.int64)
    return Dates((nanoseconds - nanoseconds[0]) / 1e9, known[0])


def _of_numpy(array: NDArray[Any], file: str, column: str, *, is_utc: bool) -> Dates:
    absent = np.isnat(array)
    faults: tuple[Diagnostic, ...] = ()
    if absent.any():
        row, more = int(np.argmax(absent)), int(absent.sum()) - 1
        faults = (cell_errors.missing_value(file, row, column, "NaT", more, None, is_time=True),)
    if absent.all():
        return Dates(np.full(len(array), np.nan), None, faults)
    unit, count = np.datetime_data(array.dtype)
    # `datetime64[10ms]` counts in tens; astype() brings it to single ticks
    if unit not in _PER_SECOND or count != 1:
        # seconds reach farther than any date, and nanoseconds farther than what is finer
        unit = "ns" if unit in ("ps", "fs", "as") else "s" if unit not in _PER_SECOND else unit
        array = array.astype(f"datetime64[{unit}]")
    ticks, length = array.astype(np.int64), 10**9 // _PER_SECOND[unit]
    # before anything is multiplied: int64 nanoseconds overflow without a word
    far = ~absent & ((ticks <= -FARTHEST // length) | (ticks >= FARTHEST // length))
    if far.any():
        row, more = int(np.argmax(far)), int(far.sum()) - 1
        wild = data_units.too_far_a_moment(file, row, column, str(array[row]), more)
        return Dates(np.full(len(array), np.nan), None, (*faults, wild))
    first = int(ticks[~absent][0])
    # subtracted as integers, so that the quotient is exact to the last digit that a log has
    seconds = np.where(absent, np.nan, (ticks - first) / _PER_SECOND[unit])
    return Dates(seconds, Moment(first * length, is_utc), faults)
