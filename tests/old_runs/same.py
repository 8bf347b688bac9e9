"""Compares what versions compute, and lays out a kept version for commands."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TOLERANCE = 1e-9
"""Relative. In another numpy and on another processor tanh and sums have other last bits, and a
rollout of 80 rows adds them up."""
_KEPT = ("trained", "data", "*.program.json", "*.safetensors")


def kept(version: Path, folder: Path) -> Path:
    """A copy of a version without its specs: runs and programs bring what they need."""
    folder.mkdir()
    for path in (path for pattern in _KEPT for path in version.glob(pattern)):
        copy = shutil.copytree if path.is_dir() else shutil.copy
        copy(path, folder / path.name)
    return folder


def differences(expected: Any, found: Any) -> list[str]:
    """The places of `expected` that `found` has otherwise or not at all; it may have more."""
    return list(_differences(expected, found, ""))


def _differences(expected: Any, found: Any, place: str) -> Iterator[str]:
    match expected, found:
        case dict(), dict():
            for key, value in expected.items():
                yield from _differences(value, found.get(key, ...), f"{place}.{key}".lstrip("."))
        case list(), list() if len(expected) == len(found):
            for i, pair in enumerate(zip(expected, found, strict=True)):
                yield from _differences(*pair, f"{place}[{i}]")
        case float(), float() | int() if math.isclose(expected, found, rel_tol=TOLERANCE):
            return
        case _:
            if expected != found:
                yield place
