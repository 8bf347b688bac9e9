"""Compares a text that the product writes with the file of it in the repository."""

import difflib
import re
from pathlib import Path


def without_identity(text: str) -> str:
    """A generated text without the hashes of its spec and of all files of its export."""
    return re.sub(r"[0-9a-f]{64}", "…", text)


def assert_golden(path: Path, text: str, accept: bool) -> None:
    """Fails with a diff when `path` does not hold exactly `text`; with `accept` writes it instead.

    Accepted files are read in `git diff` before they are committed: that reading is the test.
    """
    if accept:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode())
        return
    hint = f"pytest --accept writes {path.name}; then read the diff"
    assert path.is_file(), f"{path} does not exist; {hint}"
    expected = path.read_bytes().decode()
    if text == expected:
        return
    difference = difflib.unified_diff(
        expected.splitlines(keepends=True),
        text.splitlines(keepends=True),
        fromfile=str(path),
        tofile="written now",
    )
    raise AssertionError(f"{hint}\n" + "".join(difference))
