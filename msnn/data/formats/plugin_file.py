"""Reads data files by the function of a plug-in, and checks the columns that it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msnn.data.formats.arrays.array_columns import NamedArrays, has_dates
from msnn.data.formats.table import ColumnKey, ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data.files import unreadable_file
from msnn.errors.data.rows import unusable_array
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.errors.plugins import faulty_plugin, what_was_raised
from spec_schema.fields.entry import LateObject
from spec_schema.plugins import fault_of_refusal, plugins_with, prints_to_stderr
from spec_schema.registry import FormatLine


@dataclass(frozen=True, slots=True)
class DataColumns:
    """The columns of a data file, all of one length."""

    values: Mapping[str, ArrayLike]
    """The columns by name: numbers with NaN for a missing value, `datetime64` or `timedelta64`."""
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """The units that the file states for columns, as text."""


@dataclass(frozen=True, slots=True)
class PluginReader:
    """The reader of a plug-in's format: (path, name in messages, wanted, _) → columns."""

    module: str
    function: str
    format: str
    package: str
    """Name and version of the plug-in's package."""
    is_text: bool
    is_of_all: bool = False
    """True to read all columns of numbers and dates, not those that are wanted."""

    def of_all(self) -> PluginReader:
        """The reader of all columns of numbers and dates."""
        return replace(self, is_of_all=True)

    def __call__(
        self, path: Path, shown: str, wanted: WantedColumns, dialect: Dialect
    ) -> ColumnTable:
        """The columns. Raises SpecError for a file or a plug-in with a mistake."""
        del dialect  # lays out text of our own formats
        try:
            with prints_to_stderr():
                found: object = LateObject(self.module, self.function).value(path, shown)
        except MemoryError:
            raise
        except SpecError as error:
            reason = fault_of_refusal(error)
            if reason is None:
                raise
            raise SpecError((self.fault(shown, reason),)) from error
        # a plug-in may fail in any way
        except (Exception, SystemExit) as error:
            if isinstance(error, OSError) and error.filename == str(path):
                fault = unreadable_file(shown, error.strerror or str(error))
            else:
                fault = self.fault(shown, what_was_raised(error, self.module))
            raise SpecError((fault,)) from error
        arrays = self._arrays(found, shown)
        if not self.is_of_all:
            self._refuse_dates(arrays, wanted, shown)
        table = NamedArrays(
            shown,
            tuple(arrays.values),
            lambda name: cast("NDArray[Any]", arrays.values[name]),
            unit_texts=lambda name: ((arrays.units[name],),) if name in arrays.units else (),
        )
        return table.table(_all_of(arrays) if self.is_of_all else wanted)

    def _refuse_dates(self, arrays: DataColumns, wanted: WantedColumns, shown: str) -> None:
        """Raises SpecError for dates and durations that feed anything but the time."""
        faults: list[Diagnostic] = []
        for key, user in wanted.users.items():
            kind = np.asarray(arrays.values.get(str(key), 0)).dtype.kind
            if kind in "mM" and key not in wanted.moments:
                held = "dates (datetime64)" if kind == "M" else "durations (timedelta64)"
                reason = f"the reader of the package {self.package} returns {held}, not numbers"
                faults.append(unusable_array(str(key), shown, user, reason))
        if faults:
            raise SpecError(faults)

    def fault(self, shown: str, reason: str) -> Diagnostic:
        """The diagnostic E0230 for a mistake of the plug-in."""
        part = f"cannot read {shown}: the reader of {self.format} files"
        return faulty_plugin(self.package, part, reason)

    def _arrays(self, found: object, shown: str) -> DataColumns:
        """The columns as arrays. Raises SpecError if they are no table."""

        def fault(reason: str) -> SpecError:
            return SpecError((self.fault(shown, reason),))

        if not isinstance(found, DataColumns):
            raise fault(f"returned a {type(found).__name__}, not `msnn.extending.DataColumns`")
        for mapping, kind in ((found.values, object), (found.units, str)):
            if not _is_by_name(mapping, kind):
                raise fault("returned columns or units that are no mapping by names of columns")
        if unknown := [name for name in found.units if name not in found.values]:
            named = ", ".join(f"`{name}`" for name in unknown)
            raise fault(f"returned a unit for {named}, which is none of its columns")
        try:
            values = {name: _array(column) for name, column in found.values.items()}
        except (TypeError, ValueError) as error:
            raise fault(f"returned a column that is no array: {error}") from error
        lengths = {f"`{name}` has {_rows(array)}" for name, array in values.items()}
        if len({_rows(array) for array in values.values()}) > 1:
            raise fault(f"returned columns of unequal lengths: {', '.join(sorted(lengths)[:4])}")
        return replace(found, values=values)


def _array(column: ArrayLike) -> NDArray[Any]:
    """The column as an array, with NaN or NaT for cells that a mask leaves out."""
    if not isinstance(column, np.ma.MaskedArray):
        return np.asarray(column)
    cells = cast("np.ma.MaskedArray[Any, Any]", column)
    if not np.ma.is_masked(cells):
        return np.asarray(cells.data)
    values = np.array(cells.data, dtype=float if cells.dtype.kind in "biu" else None)
    if values.dtype.kind not in "fmM":
        raise ValueError(f"masked cells of {values.dtype} have no missing value")
    values[np.ma.getmaskarray(cells)] = np.nan if values.dtype.kind == "f" else "NaT"
    return values


def _is_by_name(mapping: object, kind: type) -> bool:
    return isinstance(mapping, Mapping) and all(
        isinstance(name, str) and isinstance(each, kind)
        for name, each in cast("Mapping[object, object]", mapping).items()
    )


def _rows(array: NDArray[Any]) -> str:
    return f"{len(array)} rows" if array.ndim else "one value"


def _all_of(arrays: DataColumns) -> WantedColumns:
    dates = frozenset(name for name, each in arrays.values.items() if has_dates(np.asarray(each)))
    numbers = [n for n, each in arrays.values.items() if np.asarray(each).dtype.kind in "biufm"]
    users: dict[ColumnKey, str] = dict.fromkeys((*numbers, *sorted(dates)), "the new spec")
    return WantedColumns(users, optional=frozenset(numbers), moments=dates)


def plugin_reader(line: FormatLine, suffix: str) -> PluginReader:
    """The reader of a plug-in's format, which files with the suffix have."""
    (plugin,) = plugins_with([("format", suffix)])
    return PluginReader(
        line.read.module,
        line.read.name,
        line.name,
        f"{plugin.package} {plugin.version}",
        is_text=line.is_text,
    )
