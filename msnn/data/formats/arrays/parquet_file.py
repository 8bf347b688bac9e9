"""Reads columns from Parquet files with pyarrow; only requested columns are decoded."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_attributes import (
    UnitTexts,
    packing_in,
    packing_of_column,
    unit_of_column,
    units_in,
)
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.unpacked_size import refuse_unpacking
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """The requested columns of the file; null is a missing value.

    Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    # for whoever watches this process: arrow opens it in C++
    sys.audit("open", path, "rb", os.O_RDONLY)
    try:
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            # a repeated value takes almost no space in the file, but 8 bytes per row in memory
            refuse_unpacking(path, shown, 8 * file.metadata.num_rows * len(wanted.users))
            names = tuple(str(name) for name in file.schema_arrow.names)
            zoned = zoned_columns(file.schema_arrow)
            arrays = NamedArrays(
                shown,
                names,
                lambda name: _array(file, name),
                zoned,
                partial(units_of_field, file.schema_arrow),
                partial(packing_of_field, file.schema_arrow),
            )
            return arrays.table(wanted)
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error


def _array(file: Any, name: str) -> NDArray[Any]:
    # a group of rows at a time: arrow's own memory for a whole column is as large as the column
    groups = [
        as_array(file.read_row_group(group, [name]).column(0))
        for group in range(file.num_row_groups)
    ]
    # numpy's memory, also of a single group: arrow keeps its own for later reads
    array = np.concatenate(groups) if groups else as_array(file.read([name]).column(0))
    groups.clear()
    arrow.default_memory_pool().release_unused()
    return array


def zoned_columns(schema: Any) -> frozenset[str]:
    """The names of date columns in UTC."""
    return frozenset(
        str(field.name)
        for field in schema
        if arrow.types.is_timestamp(field.type) and field.type.tz is not None
    )


def units_of_field(schema: Any, name: str) -> UnitTexts:
    """The units in the metadata of the column and of the file, such as pandas' `attrs`."""
    of_field = units_in(schema.field(name).metadata or {})
    return [*of_field, *unit_of_column(schema.metadata or {}, name)]


def packing_of_field(schema: Any, name: str) -> Mapping[str, Any]:
    """The attributes for unpacking, in the metadata of the column and of the file."""
    of_table = packing_of_column(schema.metadata or {}, name)
    return of_table | packing_in(schema.field(name).metadata or {})


def as_array(column: Any) -> NDArray[Any]:
    """The numbers or dates of a column as numpy array; null becomes NaN."""
    # numpy would make objects of them
    if arrow.types.is_decimal(column.type):
        column = column.cast(arrow.float64())
    if arrow.types.is_integer(column.type) and column.null_count:
        column = column.cast(arrow.float64())  # an integer cannot be NaN
    if arrow.types.is_boolean(column.type) and column.null_count:
        # arrow casts no boolean to a float directly
        column = column.cast(arrow.int8()).cast(arrow.float64())
    return np.asarray(column.to_numpy())
