"""Lays out tables, plain or as Markdown, and detects terminals."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Sequence
from contextvars import ContextVar
from typing import TextIO

from spec_schema.late_dataclass import dataclass

GAP = "  "

LINE_WIDTH: ContextVar[int | None] = ContextVar("LINE_WIDTH", default=None)
"""Columns that a line may take: those of the terminal that shows it; None for any number."""


@dataclass(frozen=True, slots=True)
class Table:
    """A header and rows of cells, before anything is laid out."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    """Indices of the columns that end at the right."""

    @property
    def text(self) -> str:
        """The table as lines for a terminal."""
        return table_text(self.header, self.rows, self.numbers)

    @property
    def markdown(self) -> str:
        """The table in Markdown; characters with a meaning in Markdown are escaped."""
        kept = self.filled
        rule = ["---:" if i in self.numbers else "---" for i in kept]
        lines = [[self.header[i] for i in kept], rule]
        lines += [[_unmarked(row[i]) for i in kept] for row in self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    @property
    def filled(self) -> Sequence[int]:
        """Indices of the columns that are not empty in every row."""
        return [i for i in range(len(self.header)) if any(row[i] for row in self.rows)]


def table_text(
    header: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()
) -> str:
    """The header and the rows as lines; columns whose indices are in `numbers` are right-aligned.

    Columns that are empty in every row are omitted. A table that is wider than `LINE_WIDTH`
    continues below, with its first column repeated. No line ends in blanks, and the last one has no
    line end. Characters that cannot be printed become blanks.
    """
    rows = [tuple(_printable(cell) for cell in row) for row in rows]
    kept = Table(header, rows).filled
    lines = [[line[i] for i in kept] for line in (header, *rows)]
    widths = [max(_width(line[column]) for line in lines) for column in range(len(kept))]
    right = [index in numbers for index in kept]
    return "\n\n".join(
        "\n".join(
            GAP.join(_padded(line[i], widths[i], right[i]) for i in block).rstrip()
            for line in lines
        )
        for block in _blocks(widths, LINE_WIDTH.get())
    )


_MARKUP = str.maketrans({character: f"\\{character}" for character in "\\`*_{}[]<>()#+!|~$"})


def _unmarked(cell: str) -> str:
    return _printable(cell).translate(_MARKUP)


def _blocks(widths: Sequence[int], most: int | None) -> list[list[int]]:
    """Groups of column indices that fit next to each other in `most` characters; each has
    column 0.
    """
    blocks = [list(range(min(1, len(widths))))]
    for column in range(1, len(widths)):
        block = [*blocks[-1], column]
        width = sum(widths[i] for i in block) + len(GAP) * (len(block) - 1)
        if most is None or width <= most or len(block) <= 2:
            blocks[-1] = block
        else:
            blocks.append([0, column])
    return blocks


def count(number: int, noun: str) -> str:
    """`1 input`, `2 inputs`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _printable(cell: str) -> str:
    return "".join(c if c.isprintable() else " " for c in cell)


def _padded(cell: str, width: int, right: bool) -> str:
    blanks = " " * (width - _width(cell))
    return blanks + cell if right else cell + blanks


def _width(text: str) -> int:
    """The number of terminal columns that the text takes; wide characters take two."""
    return sum(_columns(character) for character in text)


def _columns(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def is_live(stream: TextIO) -> bool:
    """True if the stream is a terminal that can rewrite lines."""
    return stream.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
