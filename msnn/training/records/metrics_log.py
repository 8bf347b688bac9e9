"""Adds an epoch after the other to `metrics.jsonl`, in a file that is opened once a run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from backends.files.appended_file import AppendedFile


class MetricsLog:
    """Lines of JSON, each handed to the system as it comes, so that others can follow them."""

    def __init__(self, path: Path) -> None:
        self._file = AppendedFile(path)

    def append(self, record: Mapping[str, Any]) -> None:
        """Adds one line; numbers that JSON has no word for become null."""
        line = json.dumps(finite(record), ensure_ascii=False) + "\n"
        self._file.write(line.encode())

    def close(self) -> None:
        """Lets the file go; a later line opens it again."""
        self._file.close()


def finite(value: Any) -> Any:
    """The value with null for numbers that JSON has no word for."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {key: finite(part) for key, part in cast("dict[str, Any]", value).items()}
        case list():
            return [finite(part) for part in cast("list[Any]", value)]
        case _:
            return value
