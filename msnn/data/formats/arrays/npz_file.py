"""Reads columns from NumPy's `.npz` archives; pickled objects are refused."""

from __future__ import annotations

import zipfile
import zlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.arrays.array_units import unit_beside
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.unpacked_size import refuse_unpacking
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The wanted arrays of the archive. Raises SpecError with everything that is wrong."""
    del dialect  # lays out text
    try:
        # numpy leaves a broken file open that it opened itself
        with path.open("rb") as file:
            # a pickle runs code when it is read
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise SpecError((errors.unreadable_file(shown, "it is a lone array"),))
            directory = archive.zip.infolist() if archive.zip else []
            sizes = {part.filename.removesuffix(".npy"): part.file_size for part in directory}
            unpacked = 0

            def get(name: str) -> NDArray[Any]:
                nonlocal unpacked
                unpacked += sizes[name]
                refuse_unpacking(path, shown, unpacked)
                return archive[name]

            names = tuple(archive.files)
            units = partial(unit_beside, names, get=get)
            return NamedArrays(shown, names, get, unit_texts=units).table(wanted)
    except (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise SpecError((errors.unreadable_file(shown, str(error) or "it is broken"),)) from error
