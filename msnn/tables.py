"""Lays out plain text tables: aligned columns, no colours, nothing that a pipe would spoil."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

GAP = "  "


def table_text(
    header: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()
) -> str:
    """The header and the rows as lines; columns whose indices are in `numbers` end at the right.

    Columns that are empty in every row are left out. No line ends in blanks; there is no line end
    after the last one. What cannot be printed (a spec's doc may hold any character) is a blank.
    """
    rows = [tuple(_printable(cell) for cell in row) for row in rows]
    kept = [i for i in range(len(header)) if any(row[i] for row in rows)]
    lines = [[line[i] for i in kept] for line in (header, *rows)]
    widths = [max(_width(line[column]) for line in lines) for column in range(len(kept))]
    right = [index in numbers for index in kept]
    return "\n".join(
        GAP.join(
            _padded(cell, width, flush)
            for cell, width, flush in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    )


def count(number: int, noun: str) -> str:
    """`1 input`, `2 inputs`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _printable(cell: str) -> str:
    return "".join(c if c.isprintable() else " " for c in cell)


def _padded(cell: str, width: int, right: bool) -> str:
    blanks = " " * (width - _width(cell))
    return blanks + cell if right else cell + blanks


def _width(text: str) -> int:
    """Columns of a terminal that the text takes."""
    return sum(_columns(character) for character in text)


def _columns(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1
