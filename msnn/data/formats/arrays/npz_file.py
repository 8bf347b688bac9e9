"""Reads columns from NumPy's `.npz` archives; pickled objects are refused."""

from __future__ import annotations

import zipfile
import zlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_attributes import unit_beside
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.unpacked_size import refuse_unpacking
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

_LONE = b"\x93NUMPY"
"""The first bytes of a `.npy` file."""


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested arrays of the archive. Raises SpecError with all errors of the file."""
    del dialect  # lays out text
    try:
        # numpy leaves a broken file open that it opened itself
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                lone = file.read(len(_LONE)) == _LONE
                reason = "it is a lone array" if lone else "it is no archive of numpy.savez"
                raise SpecError((errors.unreadable_file(shown, reason),))
            file.seek(0)
            # a pickle runs code when it is read
            archive = np.load(file, allow_pickle=False)
            directory = archive.zip.infolist() if archive.zip else []
            sizes = {part.filename.removesuffix(".npy"): part.file_size for part in directory}
            unpacked = 0

            def array(name: str) -> NDArray[Any]:
                nonlocal unpacked
                unpacked += sizes[name]
                refuse_unpacking(path, shown, unpacked)
                try:
                    return archive[name]
                except ValueError as error:
                    # numpy's own words advise to run what the file says
                    if "pickle" not in str(error):
                        raise
                    reason = f"`{name}` holds Python objects, not numbers: save it as float64"
                    raise SpecError((errors.unreadable_file(shown, reason),)) from error

            names = tuple(archive.files)
            units = partial(unit_beside, names, get=array)
            return NamedArrays(shown, names, array, unit_texts=units).table(wanted)
    except (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error
