"""Combines an editor's text with information from the last compiled model."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from compiler.lowering.context import Kind
from msnn.features.language_server.cursor import Cursor, Heading, OutlineSection, cursor_at, outline
from msnn.features.language_server.knowledge import Knowledge, Known
from msnn.features.language_server.positions import Position, offset_of
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.names import normalised

# with dots: names of sub-models have them
_WORD = re.compile(r"[\w.]++")
_QUOTED = re.compile(r"\"[^\"]*+\"|'[^']*+'")
_COMMENT = re.compile(r"(?:^|\s)#")
_SHOWN = 8
"""Maximum number of displayed lines of a declaration."""
_LONGEST = 1_000_000
"""Maximum number of processed characters; the reader refuses longer texts."""


@dataclass(frozen=True)
class Word:
    """A name in a line: in `plant.k` it is `plant` if the position is in the first part, else
    `plant.k`. Line and columns count from zero.
    """

    text: str
    line: int
    start: int
    end: int

    @property
    def heading(self) -> Heading:
        """The place of the name as a heading of the text."""
        return Heading(self.text, self.line, self.start, self.line)


@dataclass(frozen=True)
class View:
    """The current text, and the information from the last model that compiled."""

    source: SourceText
    knowledge: Knowledge

    @cached_property
    def outline(self) -> tuple[OutlineSection, ...]:
        """The sections of the text; empty for a text longer than `_LONGEST` characters."""
        return outline(self.source) if len(self.source.text) <= _LONGEST else ()

    @cached_property
    def headings(self) -> Mapping[str, tuple[Kind, Heading]]:
        """The names that the text declares, each with its kind and place."""
        return {
            normalised(heading.name): (section.kind, heading)
            for section in self.outline
            if section.kind is not None
            for heading in section.entries
        }

    @cached_property
    def names(self) -> Mapping[str, Known]:
        """Every name of the last compiled model, and the names that are new in the text."""
        new = {
            name: Known(name=name, kind=kind, place=span_of(heading, self.source), is_new=True)
            for name, (kind, heading) in self.headings.items()
            if name not in self.knowledge.names
        }
        # what the compiler knows goes before: a text in which one is typing loses no types
        return {**self.knowledge.names, **new}

    def place(self, known: Known) -> Span:
        """The place of a name's declaration: in the current text, else where the last check found
        it, such as in another file.
        """
        found = self.headings.get(known.name)
        return known.place if found is None else span_of(found[1], self.source)

    def cursor(self, position: Position) -> Cursor:
        """The keys that lead to a position, and the text before it."""
        return cursor_at(self.source, *offset_of(position, self.source))

    def is_comment(self, position: Position) -> bool:
        """True if a position is in a comment."""
        line, column = offset_of(position, self.source)
        # a `#` in quotes is text
        before = _QUOTED.sub("", self.source.line(line + 1)[:column])
        return _COMMENT.search(before) is not None

    def declaration(self, known: Known) -> str:
        """The first lines of a name's declaration in the current text; empty if it is not there."""
        if known.name not in self.headings:
            return ""
        _, heading = self.headings[known.name]
        last = min(heading.last_line, heading.line + _SHOWN - 1, self.source.line_count - 1)
        lines = range(heading.line, last + 1)
        return textwrap.dedent("\n".join(self.source.line(n + 1) for n in lines)).rstrip()

    def word(self, position: Position) -> Word | None:
        """The name at a position; None between names."""
        line, column = offset_of(position, self.source)
        text = self.source.line(line + 1)
        for found in _WORD.finditer(text):
            if found.start() <= column <= found.end():
                dot = text.find(".", column, found.end())
                end = found.end() if dot < 0 else dot
                return Word(normalised(text[found.start() : end]), line, found.start(), end)
        return None


def span_of(heading: Heading, source: SourceText) -> Span:
    """The place of a key in the text `source`; a span counts lines and columns from one."""
    line = heading.line + 1
    return Span(
        file=source.path,
        line=line,
        column=heading.column + 1,
        end_line=line,
        end_column=heading.end_column + 1,
    )
