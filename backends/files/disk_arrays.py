"""Stores arrays larger than memory in files, which disappear with the process."""

from __future__ import annotations

import mmap
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

AT_ONCE = 1 << 22
"""Rows in memory at a time."""


PAUSE = 0.05
"""Seconds between releases of pages to the system."""


class DiskArray(np.ndarray[Any, np.dtype[Any]]):
    """An array in a file, of which the system loads the parts that are read. Views of it are
    ordinary arrays without `pages`.
    """

    pages: mmap.mmap | None
    """The mapped file; None for a view."""
    folder: Path
    copies: dict[str, DiskArray]
    """The same values in other types."""

    def __array_finalize__(self, made_of: object) -> None:
        # numpy calls this for every view, which must not count as the whole file
        self.pages, self.copies = None, {}


class ArrayFile:
    """Appends rows to a file without a name in `folder`, which is created; `array` then gives them
    as one array. Raises OSError.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  (`array` closes it)
        self._shape: tuple[int, ...] = ()
        self._rows = 0
        self._dtype = np.dtype(np.float64)

    def append(self, values: NDArray[Any]) -> None:
        """Appends rows (n, *shape). All calls must have the same shape and type."""
        self._shape, self._dtype = values.shape[1:], values.dtype
        self._rows += len(values)
        if values.size:
            self._file.write(np.ascontiguousarray(values).data.cast("B"))

    def forget(self) -> None:
        """Closes the file without reading it; the system then deletes it."""
        self._file.close()

    def array(self) -> NDArray[Any]:
        """All rows (n, *shape) as an array that reads from the file, which lives as long as the
        array. No rows can be appended afterwards.
        """
        self._file.flush()
        shape = (self._rows, *self._shape)
        # an empty file cannot be mapped
        if not np.prod(shape):
            self._file.close()
            return np.zeros(shape, self._dtype)
        pages = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        found = DiskArray(shape, self._dtype, pages)
        found.pages, found.folder = pages, self._folder
        self._file.close()
        _GIVING_BACK.watch(pages)
        return found


def laid_out(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The array with this type in C order. For an array on disk, a converted copy is also on disk
    and kept for later calls.
    """
    if not isinstance(values, DiskArray) or values.pages is None:
        return np.ascontiguousarray(values, dtype)
    if values.dtype == dtype:
        return values
    if dtype.str not in values.copies:
        file = ArrayFile(values.folder)
        for block in blocks(values):
            file.append(block.astype(dtype))
        copy = file.array()
        assert isinstance(copy, DiskArray)
        values.copies[dtype.str] = copy
    return values.copies[dtype.str]


def blocks(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Views of consecutive rows of an array, at most `AT_ONCE` rows each."""
    for begin in range(0, len(values), AT_ONCE):
        yield values[begin : begin + AT_ONCE]


class _GivingBack:
    """A thread that every `PAUSE` seconds releases the loaded parts of mapped files to the system,
    so that the process holds few. A part that is read again comes from the system's cache, or from
    the file.
    """

    def __init__(self) -> None:
        self._mapped: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()
        self._lock = threading.Lock()
        self._runs = False

    def watch(self, pages: mmap.mmap) -> None:
        """Adds a mapped file, whose loaded parts are released periodically as long as an array uses
        it.
        """
        with self._lock:
            self._mapped.add(pages)
            if not self._runs and hasattr(mmap, "MADV_DONTNEED"):
                self._runs = True
                threading.Thread(target=self._give_back, daemon=True).start()

    def _give_back(self) -> None:
        time.sleep(PAUSE)
        while self._gave_back():
            time.sleep(PAUSE)

    def _gave_back(self) -> bool:
        """Releases the loaded parts of all mapped files; returns True if there is still one.
        References to them are dropped at the end, so that arrays can be freed.
        """
        with self._lock:
            mapped = list(self._mapped)
            # under the lock: a new file is either seen here or starts a new thread
            self._runs = bool(mapped)
        for pages in mapped:
            pages.madvise(mmap.MADV_DONTNEED)
        return bool(mapped)


_GIVING_BACK = _GivingBack()
