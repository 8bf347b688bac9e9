"""Moves the series to disk file by file, so that memory holds one data file at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from backends.files.disk_arrays import ArrayFile
from backends.native.kernel_cache import cache_folder
from msnn.data.dataset import FloatArray
from msnn.data.reading.part import FilePart

_TIME = "time of rows"
"""A key that no signal has, because names of signals contain no blanks."""


class DiskSeries:
    """The series of all parts in unnamed files in the cache folder, one per signal."""

    def __init__(self) -> None:
        self._files: dict[str, ArrayFile] = {}

    def taken(self, part: FilePart) -> FilePart:
        """Appends the series of the part to disk, and returns the part without series."""
        series = part.series if part.time is None else {**part.series, _TIME: part.time}
        for name, values in series.items():
            if name not in self._files:
                # not in /tmp, which often is memory
                self._files[name] = ArrayFile(cache_folder())
            self._files[name].append(values)
        # the times of rows go to disk, too: they are as many as a signal's values
        pieces = tuple(replace(piece, time=None) for piece in part.pieces)
        empty = None if part.time is None else part.time[:0].copy()
        return replace(part, series={}, time=empty, pieces=pieces)

    def forget(self) -> None:
        """Deletes all files."""
        for file in self._files.values():
            file.forget()

    def returned(
        self, parts: Sequence[FilePart]
    ) -> tuple[list[FilePart], Mapping[str, FloatArray]]:
        """The parts with views of their series on disk, and the whole series by signal."""
        whole = {name: file.array() for name, file in self._files.items()}
        # one array for all parts, of which some may have none
        time = whole.pop(_TIME, None)
        found: list[FilePart] = []
        start = timed = 0
        for part in parts:
            rows = len(part.usable)
            own = {name: values[start : start + rows] for name, values in whole.items()}
            start += rows
            if part.time is None or time is None:
                found.append(replace(part, series=own))
                continue
            seconds = time[timed : timed + rows]
            timed += rows
            pieces = tuple(replace(piece, time=seconds) for piece in part.pieces)
            found.append(replace(part, series=own, time=seconds, pieces=pieces))
        return found, whole
