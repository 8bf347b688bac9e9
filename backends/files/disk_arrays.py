"""Keeps arrays that are larger than memory in files, which vanish with the process."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

AT_ONCE = 1 << 22
"""Rows that are in memory at a time."""


class DiskArray(np.ndarray[Any, np.dtype[Any]]):
    """An array whose pages the system reads from a file as they are needed, and takes back."""

    pages: mmap.mmap | None
    """The file; None for a part of an array."""
    folder: Path
    copies: dict[str, DiskArray]
    """The same numbers in other types."""

    def __array_finalize__(self, made_of: object) -> None:
        self.pages, self.copies = None, {}

    def give_back(self) -> None:
        """Leaves its pages to the system; those that are read again come from its cache."""
        if self.pages is not None and hasattr(mmap, "MADV_DONTNEED"):
            self.pages.madvise(mmap.MADV_DONTNEED)


class ArrayFile:
    """Rows that are written one after the other into a file without a name."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (`array` closes it)
        self._shape: tuple[int, ...] = ()
        self._rows = 0
        self._dtype = np.dtype(np.float64)

    def append(self, values: NDArray[Any]) -> None:
        """Adds rows of the shape and type of those before."""
        self._shape, self._dtype = values.shape[1:], values.dtype
        self._rows += len(values)
        if values.size:
            self._file.write(memoryview(np.ascontiguousarray(values)).cast("B"))

    def forget(self) -> None:
        """Drops what was written."""
        self._file.close()

    def array(self) -> NDArray[Any]:
        """All rows. The file lives as long as the array."""
        self._file.flush()
        shape = (self._rows, *self._shape)
        if not np.prod(shape):
            self._file.close()
            return np.zeros(shape, self._dtype)
        pages = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        found = DiskArray(shape, self._dtype, pages)
        found.pages, found.folder = pages, self._folder
        self._file.close()
        return found


def laid_out(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The array as C reads it: in memory, or on disk where it is there; copies are made once."""
    if not isinstance(values, DiskArray) or values.pages is None:
        return np.ascontiguousarray(values, dtype)
    if values.dtype == dtype:
        return values
    if dtype.str not in values.copies:
        file = ArrayFile(values.folder)
        for block in blocks(values):
            file.append(block.astype(dtype))
            values.give_back()
        copy = file.array()
        assert isinstance(copy, DiskArray)
        values.copies[dtype.str] = copy
    return values.copies[dtype.str]


def blocks(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The rows of an array, as many at a time as are in memory at once."""
    for begin in range(0, len(values), AT_ONCE):
        yield values[begin : begin + AT_ONCE]


def give_back(values: object) -> None:
    """Leaves the pages of an array on disk to the system; does nothing with any other."""
    if isinstance(values, DiskArray):
        values.give_back()
