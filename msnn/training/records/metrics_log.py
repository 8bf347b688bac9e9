"""Appends epochs to `metrics.jsonl`, which is opened once per run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from backends.files.atomic_write import AppendedFile


class MetricsLog:
    """JSON lines, each flushed immediately, so that other programs can follow them."""

    def __init__(self, path: Path) -> None:
        self._file = AppendedFile(path)

    def append(self, record: Mapping[str, Any]) -> None:
        """Appends one line; NaN and infinities become null."""
        line = json.dumps(finite(record), ensure_ascii=False) + "\n"
        self._file.write(line.encode())

    def close(self) -> None:
        """Closes the file; a later line opens it again."""
        self._file.close()


def finite(value: Any) -> Any:
    """The value with null for NaN and infinities, which JSON does not support."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {key: finite(part) for key, part in cast("dict[str, Any]", value).items()}
        case list():
            return [finite(part) for part in cast("list[Any]", value)]
        case _:
            return value
