"""Reads row groups of Parquet files one at a time, with columns from folder names."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as arrow
import pyarrow.dataset as dataset
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.arrays.parquet_file import (
    as_array,
    packing_of_field,
    units_of_field,
    zoned_columns,
)
from msnn.data.formats.unpacked_size import refuse_unpacking
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError


def row_groups(path: Path, shown: str) -> Sequence[NamedArrays]:
    """The row groups of a file as recordings; columns are read when they are requested.

    A folder `vehicle=7` above the file adds a column `vehicle` (Hive partitioning). Raises
    SpecError if the file is not Parquet.
    """
    # for whoever watches this process: arrow opens it in C++
    sys.audit("open", path, "rb", os.O_RDONLY)
    try:
        source = dataset.dataset(
            str(path.absolute()),
            format=dataset.ParquetFileFormat(
                default_fragment_scan_options=dataset.ParquetFragmentScanOptions(
                    page_checksum_verification=True
                )
            ),
            # of a lone file the folders above are not read unless asked for
            partitioning=dataset.partitioning(flavor="hive"),
        )
        # one file is one fragment
        (fragment,) = source.get_fragments()
        count = fragment.num_row_groups
        for group in fragment.row_groups:
            refuse_unpacking(path, shown, 8 * int(group.num_rows))
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error
    names = tuple(str(name) for name in source.schema.names)
    zoned = zoned_columns(source.schema)
    units = partial(units_of_field, source.schema)
    packing = partial(packing_of_field, source.schema)

    def one_group(number: int) -> NamedArrays:
        def column(name: str) -> NDArray[Any]:
            part = fragment.subset(row_group_ids=[number])
            # columns are few and groups many: threads of arrow would only add to the memory
            table = part.to_table(schema=source.schema, columns=[name], use_threads=False)
            return as_array(table.column(0))

        group = f"{shown}, row group {number}"
        return NamedArrays(group, names, column, zoned, units, packing)

    return [one_group(number) for number in range(count)]
