"""Packs files into a ZIP archive; the same files give the same bytes on every day and machine."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

_DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date that ZIP supports, used for all files of a unit."""

BINARIES = "binaries/"

_UNIX = 3
_FILE, _PROGRAM = 0o100644, 0o100755


def archive(files: Mapping[str, bytes]) -> bytes:
    """A ZIP archive of files by path, in the order of their paths."""
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for path in sorted(files):
            entry = zipfile.ZipInfo(path, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            # extractors take permission bits from systems that have them; binaries must be runnable
            entry.create_system = _UNIX
            mode = _PROGRAM if path.startswith(BINARIES) else _FILE
            entry.external_attr = mode << 16
            packed.writestr(entry, files[path], compresslevel=9)
    return found.getvalue()


def holds_binary(path: Path) -> bool:
    """True if the unit in this file contains a compiled binary."""
    with zipfile.ZipFile(path) as packed:
        return any(name.startswith(BINARIES) for name in packed.namelist())
