"""Finds the sections and names of a text from its indentation, even if it is invalid."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from compiler.lowering.context import Kind
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
"""Sections that declare names, with their kind."""

# No pattern gives back what it took: a hostile line would take the square of its length.
_KEY = r"([^\s#:{}\[\],\"'&*!|>%@`-][^:#{}\[\],\r\n]*+):(?=[ \r\n]|$)(.*)$"
_SECTION = re.compile(f"^{_KEY}", re.M)
_BELOW = re.compile(f"^( ++){_KEY}", re.M)
_IN_FLOW = re.compile(
    r"([^\s{}\[\],:\"'#]++)(\s*+:(?=[\s{\[]))?|([{\[])|([}\]])|\"[^\"]*+\"|'[^']*+'"
)


@dataclass(frozen=True, slots=True)
class Heading:
    """A key of the text: position from zero, and the last line of its value."""

    name: str
    line: int
    column: int
    last_line: int

    @property
    def end_column(self) -> int:
        """The column where the key ends."""
        return self.column + len(self.name)


@dataclass(frozen=True, slots=True)
class OutlineSection:
    """A section and the keys directly below it."""

    heading: Heading
    entries: tuple[Heading, ...]

    @property
    def kind(self) -> Kind | None:
        """The kind of names that its keys declare; None for other keys."""
        return KINDS.get(self.heading.name)


def outline(source: SourceText) -> tuple[OutlineSection, ...]:
    """The sections of a text in order."""
    found = list(_SECTION.finditer(source.text))
    ends = [*(section.start() for section in found), len(source.text)][1:]
    return tuple(
        OutlineSection(
            _heading(section[1], section.start(1), end, source),
            tuple(_entries(section, end, source)),
        )
        for section, end in zip(found, ends, strict=True)
    )


def _entries(section: re.Match[str], end: int, source: SourceText) -> Iterator[Heading]:
    """The keys of the first indentation below a section, or in its `{ }`."""
    first = _BELOW.search(source.text, section.end(), end)
    if first is None:
        yield from _in_flow(section, source.position(section.start())[0] - 1)
        return
    # deeper keys are options of entries, not names
    alike = re.compile(f"^{first[1]}{_KEY}", re.M)
    found = list(alike.finditer(source.text, first.start(), end))
    ends = [*(entry.start() for entry in found), end][1:]
    for entry, last in zip(found, ends, strict=True):
        yield _heading(entry[1], entry.start(1), last, source)


def _in_flow(section: re.Match[str], line: int) -> Iterator[Heading]:
    depth = 0
    for found in _IN_FLOW.finditer(section[2]):
        # depth 1 is in the section's own bracket
        depth += bool(found[3]) - bool(found[4])
        if found[2] and depth == 1:
            column = section.start(2) - section.start() + found.start(1)
            yield Heading(found[1], line, column, line)


def _heading(key: str, start: int, end: int, source: SourceText) -> Heading:
    """A key at an offset whose value ends before `end`."""
    line, column = source.position(start)
    # `end` begins the next key: its line, counted from one, less that line and the count
    last = source.position(end)[0] - (2 if end < len(source.text) else 1)
    return Heading(key.rstrip(), line - 1, column - 1, max(line - 1, last))
