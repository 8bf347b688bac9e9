"""Tables and paragraphs in Markdown, and pages of which some blocks are written by the tests."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

_BLOCK = re.compile(r"<!-- generated: ([a-z ]+) -->\n.*?<!-- end -->", re.DOTALL)

_MARK_OF_A_LINE = re.compile(r"[-+*=]+|#+|\d+[.)]|[|>].*|~~~.*")


def block_names(text: str) -> list[str]:
    """The generated blocks of a page: from `<!-- generated: name -->` to `<!-- end -->`."""
    return [found[1] for found in _BLOCK.finditer(text)]


def with_blocks(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """The page with its blocks written anew and all else as it is. KeyError for another block."""

    def written(found: re.Match[str]) -> str:
        return f"<!-- generated: {found[1]} -->\n\n{blocks[found[1]]()}\n\n<!-- end -->"

    return _BLOCK.sub(written, text)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a `|` inside a cell is escaped, so that it does not end the cell."""
    lines = [_line(header), "|" + "---|" * len(header)]
    return "\n".join([*lines, *(_line(row) for row in rows)])


def paragraph(docstring: str | None) -> str:
    """A docstring as paragraphs of one line each, as tables need it."""
    parts = re.split(r"\n\s*\n", (docstring or "").strip())
    return apart(*(" ".join(part.split()) for part in parts))


def prose(docstring: str | None) -> str:
    """A docstring as paragraphs in lines of 100 columns, for what stands outside of tables."""
    return apart(*map(wrapped, paragraph(docstring).split("\n\n")))


def wrapped(text: str, first: str = "", rest: str = "") -> str:
    """A paragraph in lines of 100 columns, the first of which begins with `first`.

    Code and what looks like a mark at the beginning of a line stay where they mean the same.
    """
    lines: list[str] = []
    line: list[str] = []
    for word in re.findall(r"(?:`[^`]*`|\S)+", text):
        begun = rest if lines else first
        line.append(word)
        if len(begun) + len(" ".join(line)) > 100 and len(line) > 1:
            moved = [line.pop()]
            while _MARK_OF_A_LINE.fullmatch(moved[0]) and len(line) > 1:
                moved.insert(0, line.pop())
            lines.append(begun + " ".join(line))
            line = moved
    return "\n".join([*lines, (rest if lines else first) + " ".join(line)])


def apart(*parts: str) -> str:
    """The parts with one blank line between them."""
    return "\n\n".join(parts)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
