"""Makes records for tests that read no file."""

from __future__ import annotations

from msnn.data.dataset import FileRows, Record


def whole_file(file: str, start: int, stop: int) -> Record:
    """A record of all rows of a file without time."""
    rows = FileRows(file=file, start=start, stop=stop, rows=range(stop - start), time=None)
    return Record(file, start, stop, (rows,))
