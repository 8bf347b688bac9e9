"""Extracts the errors from the output of a compiler and linker."""

from __future__ import annotations

import re

_CLOSING = re.compile(
    r"collect2: error: ld returned|linker command failed|compilation terminated"
    r"|^\d+ (?:error|warning)s?\b|process exited with code"
)
"""Lines that only report that an earlier line was a failure."""
_NAMED = re.compile(r"\berror:", re.IGNORECASE)
_ASIDE = re.compile(
    r"\b(?:warning|note):|\bin function\b.*:$|^In file included from|^\s+(?:from |\||\d+ \|)",
    re.IGNORECASE,
)


def complaints(output: str) -> list[str]:
    """The lines that name an error, otherwise all lines except warnings; the first is the cause.

    A linker writes no `error:` before missing symbols; the compiler that called it writes one after
    them. The list is empty if nothing else remains, as on a full disk.
    """
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    said = [line for line in lines if not _CLOSING.search(line)]
    for chosen in (
        [line for line in said if _NAMED.search(line)],
        [line for line in said if not _ASIDE.search(line)],
    ):
        if chosen:
            return chosen
    return []
