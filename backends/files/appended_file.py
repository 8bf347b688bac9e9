"""Appends records to an open file, each completely or not at all."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from io import SEEK_END, FileIO
from pathlib import Path

from backends.files.atomic_write import naming


@dataclass(slots=True)
class AppendedFile:
    """A file that writes its records immediately."""

    path: Path
    _file: FileIO | None = field(init=False, default=None)

    def write(self, record: bytes) -> None:
        """Appends the record. An OSError, which names the file, leaves the file unchanged."""
        with naming(self.path):
            if self._file is None:
                # unbuffered: otherwise `close` would retry data that a full disk refused
                self._file = self.path.open("ab", buffering=0)
            end = self._file.seek(0, SEEK_END)
            rest = record
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
            except OSError:
                # remove the first bytes of a partly written record
                with suppress(OSError):
                    self._file.truncate(end)
                raise

    def close(self) -> None:
        """Closes the file; a later record opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None
