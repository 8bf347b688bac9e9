"""Reads columns from HDF5 files; a dataset in groups has its path as name, `run1/speed`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_attributes import (
    UnitTexts,
    packing_in,
    unit_beside,
    units_in,
    with_netcdf_fill,
)
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

_NETCDF = "_NCProperties"
"""An attribute that the NetCDF library adds to its files."""


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested datasets of the file, of shape (rows,) or (rows, columns).

    Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    return read_datasets(path, shown, wanted, transposed=False, separator="/")


def read_datasets(
    path: Path, shown: str, wanted: WantedColumns, *, transposed: bool, separator: str
) -> ColumnTable:
    """The requested datasets; `transposed` if matrices are stored by columns, as MATLAB does.

    Datasets whose values are in another file are ignored: a data file must not read other files.
    """
    try:
        with h5py.File(path, "r") as file:
            found = _datasets(file)
            # a struct in MATLAB 7.3 is a group: `log.speed`, not `log/speed`
            names = {name.replace("/", separator): name for name in found}

            def get(name: str) -> NDArray[Any]:
                array = np.asarray(found[names[name]][()])
                return array.T if transposed else array

            def units(name: str) -> UnitTexts:
                of_array = units_in(found[names[name]].attrs)
                return [*of_array, *unit_beside(names, name, get)]

            def packing(name: str) -> Mapping[str, Any]:
                entry = found[names[name]]
                own = packing_in(entry.attrs)
                return own if _NETCDF not in file.attrs else with_netcdf_fill(own, entry.dtype)

            # inside `with`: datasets are read when they are asked for
            arrays = NamedArrays(shown, tuple(names), get, unit_texts=units, packing=packing)
            return arrays.table(wanted)
    # what h5py raises for broken files, one for each layer of the C library
    except (OSError, RuntimeError, KeyError, TypeError) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error


def _datasets(file: Any) -> dict[str, Any]:
    """All datasets of the file by path, without external links and virtual datasets."""
    found: dict[str, Any] = {}

    def visit(name: str, entry: Any) -> None:
        if isinstance(entry, h5py.Dataset) and not entry.external and not entry.is_virtual:
            found[name] = entry

    file.visititems(visit)  # visits hard links only
    # `#refs#` and `#subsystem#` are MATLAB's own
    return {name: entry for name, entry in found.items() if not name.startswith("#")}
