"""Says of a table of text that is not UTF-8 how it becomes that."""

from __future__ import annotations

import shlex
from pathlib import Path

from msnn.errors.data.files import unreadable_file
from spec_schema.diagnostics.diagnostic import Diagnostic

_MARKS = {b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
"""What begins a file that says its encoding."""
_EUROPEAN = "WINDOWS-1252"
"""What German, French and other spreadsheets and loggers write without saying so."""


def not_utf8(path: Path, shown: str, error: UnicodeDecodeError) -> Diagnostic:
    """E0802, with the line that converts the file."""
    with path.open("rb") as file:
        # a guess that the message shows as a command, not one that is read by
        encoding = _MARKS.get(file.read(2), _EUROPEAN)
    reason = f"it is not UTF-8 text (byte {error.start} is {error.object[error.start]:#04x})"
    name = shlex.quote(shown)
    repair = (
        f"save it as `CSV UTF-8`, or convert it: `iconv -f {encoding} -t UTF-8 {name} > utf8.csv`"
    )
    return unreadable_file(shown, reason, repair)
