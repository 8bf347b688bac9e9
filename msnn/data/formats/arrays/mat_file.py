"""Reads columns from MATLAB files: versions 5 to 7.2 with scipy, version 7.3 as HDF5."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from msnn.data.formats.arrays.array_attributes import unit_beside
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.arrays.hdf5_file import read_datasets
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested variables; a field of a struct has a name such as `log.speed`.

    Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    if h5py.is_hdf5(path):
        return read_datasets(path, shown, wanted, transposed=True, separator=".")
    try:
        # mat_dtype=False keeps integers small; structs as records have fields by name
        found = loadmat(path, mat_dtype=False, squeeze_me=False, struct_as_record=True)
    except (
        # scipy parses without checking: broken files show as whatever came first
        *(OSError, ValueError, TypeError, NotImplementedError, IndexError, KeyError),
        *(MatReadError, struct.error, zlib.error),
    ) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error
    arrays = dict(_variables("", {n: v for n, v in found.items() if not n.startswith("__")}))
    get = arrays.__getitem__
    units = partial(unit_beside, arrays, get=get)
    return NamedArrays(shown, tuple(arrays), get, unit_texts=units).table(wanted)


def _variables(prefix: str, values: dict[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in values.items():
        array = np.asarray(value)
        if array.dtype.names is None:
            yield prefix + name, array
        elif array.size == 1:
            # a struct of one element; arrays of structs are no columns
            fields = {field: array[field].item() for field in array.dtype.names}
            yield from _variables(f"{prefix}{name}.", fields)
