"""The format of `.jsonl` files: one JSON object per line, as loggers of services write them.

`{"t": 0.1, "u": 2.5}` is a row. Keys are the names of columns; a row may lack some.
"""

import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from msnn.extending import DataColumns, Span, SpecError, error

_MISSING = float("nan")


def read(path: Path, shown: str) -> DataColumns:
    """The columns of a file. Raises SpecError at the first line that is no JSON object."""
    rows: list[Any] = []
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            try:
                row = json.loads(line, parse_int=float)
            except ValueError as fault:
                _refuse(shown, number, f"is no JSON: {fault}")
            if not isinstance(row, dict):
                _refuse(shown, number, 'is no JSON object such as {"t": 0.1, "u": 2.5}')
            rows.append(row)
    # in the order in which the file has them
    names = dict.fromkeys(name for row in rows for name in row)
    return DataColumns({name: _column(name, rows) for name in names})


def _column(name: str, rows: list[dict[str, Any]]) -> np.ndarray:
    """Numbers, with NaN where a row has `null` or lacks the key; texts if another value occurs."""
    values = [_MISSING if (value := row.get(name)) is None else value for row in rows]
    if all(isinstance(value, int | float) for value in values):
        return np.array(values, dtype=float)
    return np.array([str(value) for value in values])


def _refuse(shown: str, line: int, reason: str) -> NoReturn:
    place = Span(file=shown, line=line, column=1, end_line=line, end_column=1)
    message = f"line {line} of {shown} {reason}"
    raise SpecError([error("X0002", place, message, help="remove or repair the line")])
