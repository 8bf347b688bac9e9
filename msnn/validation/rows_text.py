"""Describes which rows were scored, to reveal off-by-one differences between tools."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import Dataset, IntArray


def rows_text(data: Dataset, rows: IntArray) -> str:
    """`rows 5…1023 of 1024`, or counts for several recordings; `rows` are sorted and unique."""
    if not len(rows):
        return "no rows"
    # rows are counted from the beginning of their record, as files have them
    bounds = [(record.start, record.stop) for record in data.records]
    counts = np.diff(np.searchsorted(rows, bounds))[:, 0].tolist()
    touched = [record for record, count in zip(data.records, counts, strict=True) if count]
    if len(touched) > 1:
        total = sum(record.stop - record.start for record in touched)
        return f"{len(rows)} of {total} rows in {len(touched)} records"
    record = touched[0]
    first, last = int(rows[0]) - record.start, int(rows[-1]) - record.start
    total = record.stop - record.start
    if len(rows) == last - first + 1:
        return f"rows {first}…{last} of {total}"
    return f"{len(rows)} of rows {first}…{last} of {total}"
