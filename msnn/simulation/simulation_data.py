"""The data of a simulation that is not the spec's own: given files, or arrays of a session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.data.reading.files import data_of_files, matching
from msnn.data.reading.load import load_data
from msnn.errors.data_files import no_file
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.sections.data.data import Data, Source


def file_data(model: Model, program: Program, files: Sequence[Path]) -> Dataset:
    """The records in CSV files, read as the spec's `data` section lays out its first source.

    A spec without that section has plain comma-separated files with a column a signal. Raises
    SpecError with the faults of all files.
    """
    missing = [file for file in files if not matching(Path.cwd(), str(file))]
    if missing:
        raise SpecError([no_file(str(file), None, None) for file in missing])
    data = data_of_files(model.spec.data or _plain_layout(model), files)
    try:
        return load_data(program, data, Path.cwd())
    except SpecError as error:
        raise SpecError(error.diagnostics, (*error.sources, *model.sources)) from None


def record_data(program: Program, arrays: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """The arrays (rows, *shape) that the program reads, in float64.

    Raises ValueError for a signal that is missing, has another shape or another number of rows.
    """
    found: dict[str, FloatArray] = {}
    rows: int | None = None
    for signal in program.signals:
        if signal.name not in arrays:
            raise ValueError(f"the data has no `{signal.name}`")
        array = np.asarray(arrays[signal.name], np.float64)
        shape = tuple(axis.size for axis in signal.axes)
        rows = len(array) if rows is None and array.ndim else rows
        if array.shape != (rows, *shape):
            wanted = ", ".join(map(str, ("rows" if rows is None else rows, *shape)))
            raise ValueError(f"`{signal.name}` has the shape {array.shape}, not ({wanted})")
        found[signal.name] = array
    return found


def _plain_layout(model: Model) -> Data:
    place = model.spec.place
    source = Source.model_construct(place=place, files=())
    return Data.model_construct(place=place, source={"data": source})
