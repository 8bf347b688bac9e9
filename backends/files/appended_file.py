"""Adds records to the end of a file that stays open, each of them whole or not at all."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from io import SEEK_END, FileIO
from pathlib import Path

from backends.files.atomic_write import naming


@dataclass(slots=True)
class AppendedFile:
    """A file whose records are handed to the system as they come."""

    path: Path
    _file: FileIO | None = field(init=False, default=None)

    def write(self, record: bytes) -> None:
        """Adds the record. OSError, which names the file, leaves it as it was."""
        with naming(self.path):
            if self._file is None:
                # without a buffer: what a full disk did not take would be written again by `close`
                self._file = self.path.open("ab", buffering=0)
            end = self._file.seek(0, SEEK_END)
            rest = record
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
            except OSError:
                # a full disk takes the first bytes of a record, which no reader knows what to do
                # with
                with suppress(OSError):
                    self._file.truncate(end)
                raise

    def close(self) -> None:
        """Lets the file go; a later record opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None
