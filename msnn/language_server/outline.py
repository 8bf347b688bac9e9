"""Finds the sections and names of a text by its indentation alone, be it correct or not."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from compiler.lowering.scope import Kind
from spec_schema.diagnostics.source import SourceText

KINDS = {
    "use": Kind.SUBMODEL,
    "dims": Kind.DIMENSION,
    "inputs": Kind.INPUT,
    "targets": Kind.TARGET,
    "constants": Kind.CONSTANT,
    "parameters": Kind.PARAMETER,
    "layers": Kind.LAYER,
    "functions": Kind.FUNCTION,
    "states": Kind.STATE,
    "equations": Kind.EQUATION,
    "outputs": Kind.OUTPUT,
}
"""The sections that declare names."""

# No pattern gives back what it took: a hostile line would take the square of its length.
_LINE = re.compile(r"^( *+)([^\s#:{}\[\],\"'&*!|>%@`-][^:#{}\[\],\r\n]*+):(?=[ \r\n]|$)(.*)$", re.M)
_IN_FLOW = re.compile(
    r"([^\s{}\[\],:\"'#]++)(\s*+:(?=[\s{\[]))?|([{\[])|([}\]])|\"[^\"]*+\"|'[^']*+'"
)


@dataclass(frozen=True, slots=True)
class Heading:
    """A key of the text: where it stands, counted from zero, and the last line of its value."""

    name: str
    line: int
    column: int
    last_line: int

    @property
    def end_column(self) -> int:
        """Where the key ends."""
        return self.column + len(self.name)


@dataclass(frozen=True, slots=True)
class Section:
    """A section and the keys right below it."""

    heading: Heading
    entries: tuple[Heading, ...]

    @property
    def kind(self) -> Kind | None:
        """What its keys declare; None where they are no names."""
        return KINDS.get(self.heading.name)


def outline(source: SourceText) -> tuple[Section, ...]:
    """The sections of a text in its order."""
    found = list(_LINE.finditer(source.text))
    starts = [index for index, line in enumerate(found) if not line[1]]
    ends = [*starts, len(found)][1:]
    lines = [source.position(line.start())[0] - 1 for line in found]
    lines.append(source.line_count)
    return tuple(
        Section(
            _heading(found[start], lines[start], lines[end] - 1),
            tuple(_entries(found[start:end], lines[start : end + 1])),
        )
        for start, end in zip(starts, ends, strict=True)
    )


def _entries(found: list[re.Match[str]], lines: list[int]) -> Iterator[Heading]:
    """The keys of the first indentation below a section, or those in its `{ }`."""
    section, *below = found
    if not below:
        yield from _in_flow(section, lines[0])
        return
    indent = below[0][1]
    entries = [index for index, line in enumerate(below) if line[1] == indent]
    for index, following in zip(entries, [*entries[1:], len(below)], strict=True):
        yield _heading(below[index], lines[index + 1], lines[following + 1] - 1)


def _in_flow(section: re.Match[str], line: int) -> Iterator[Heading]:
    depth = 0
    for found in _IN_FLOW.finditer(section[3]):
        depth += bool(found[3]) - bool(found[4])
        if found[2] and depth == 1:
            column = section.start(3) - section.start() + found.start(1)
            yield Heading(found[1], line, column, line)


def _heading(found: re.Match[str], line: int, last: int) -> Heading:
    return Heading(found[2].rstrip(), line, len(found[1]), max(line, last))
