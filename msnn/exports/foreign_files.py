"""Prevents a command from replacing other people's files under names that it chose itself."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msnn.errors.commands import foreign_file
from spec_schema.diagnostics.diagnostic import SpecError

_READ = 1 << 20
"""Number of bytes of a file that are searched for the sign."""
_SIGN = b"msnn"
"""A text in comments and descriptions of msnn; at least one file of each export contains it."""


def spare_foreign_files(places: Iterable[Path], sign: bytes = _SIGN) -> None:
    """Raises SpecError (E1054) if these files exist and none of them contains the sign.

    An existing export is replaced as a whole, including manual changes.
    """
    there = [path for path in places if path.is_file()]
    if there and not any(sign in _beginning(path) for path in there):
        raise SpecError([foreign_file(str(there[0]))])


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_READ)
