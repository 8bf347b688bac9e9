"""Keeps a command from replacing files of somebody else under names that the user did not write."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msnn.errors.commands import foreign_file
from spec_schema.diagnostics.diagnostic import SpecError

_READ = 1 << 20
"""Bytes of a file in which the sign is looked for."""
_SIGN = b"msnn"
"""In comments and descriptions of what msnn writes; in each export it is in some file at least."""


def spare_foreign_files(places: Iterable[Path], sign: bytes = _SIGN) -> None:
    """Raises SpecError (E1054) where files are in these places, and none of them has the sign.

    An export that is there already is replaced as a whole, with what was changed in it.
    """
    there = [path for path in places if path.is_file()]
    if there and not any(sign in _beginning(path) for path in there):
        raise SpecError([foreign_file(str(there[0]))])


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_READ)
