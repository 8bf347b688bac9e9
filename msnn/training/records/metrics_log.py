"""Adds an epoch after the other to `metrics.jsonl`, in a file that is opened once a run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any, cast

from backends.files.atomic_write import naming


@dataclass(slots=True)
class MetricsLog:
    """Lines of JSON, each handed to the system as it comes, so that others can follow them."""

    path: Path
    _file: FileIO | None = field(init=False, default=None)

    def append(self, record: Mapping[str, Any]) -> None:
        """Adds one line; numbers that JSON has no word for become null."""
        line = json.dumps(finite(record), ensure_ascii=False) + "\n"
        with naming(self.path):
            if self._file is None:
                # without a buffer: what a full disk did not take would be written again by `close`
                self._file = self.path.open("ab", buffering=0)
            rest = line.encode()
            while rest:
                rest = rest[self._file.write(rest) :]

    def close(self) -> None:
        """Lets the file go; a later line opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None


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
