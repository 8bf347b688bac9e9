"""Joins the text of an editor to what the last model that compiled tells of its names."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from msnn.language_server.cursor import Cursor, cursor_at
from msnn.language_server.knowledge import Knowledge, Known
from msnn.language_server.outline import Heading, Section, outline
from msnn.language_server.positions import Position, offset_of
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.names import normalised

_WORD = re.compile(r"[\w.]++")
_QUOTED = re.compile(r"\"[^\"]*+\"|'[^']*+'")
_COMMENT = re.compile(r"(?:^|\s)#")
_SHOWN = 8
"""Lines of a declaration that are shown."""
_LONGEST = 1_000_000
"""Characters of a text that is looked at; the reader refuses a longer one."""


@dataclass(frozen=True)
class Word:
    """A name in a line, as far as the place in it: of `plant.k` in its first part, `plant`."""

    text: str
    line: int
    start: int
    end: int

    @property
    def heading(self) -> Heading:
        """Its place."""
        return Heading(self.text, self.line, self.start, self.line)


@dataclass(frozen=True)
class View:
    """A text as it is now, and what was known of it last."""

    source: SourceText
    knowledge: Knowledge

    @cached_property
    def outline(self) -> tuple[Section, ...]:
        """The sections of the text."""
        return outline(self.source) if len(self.source.text) <= _LONGEST else ()

    @cached_property
    def names(self) -> Mapping[str, Known]:
        """Every name: those that stand in the text where they stand now, and all others."""
        found = dict(self.knowledge.names)
        for section in self.outline:
            if section.kind is None:
                continue
            for heading in section.entries:
                name, place = normalised(heading.name), span_of(heading, self.source)
                known = found.get(name)
                if known is None or known.place.file != place.file:
                    found[name] = Known(name=name, kind=section.kind, place=place, is_new=True)
                elif known.place != place:
                    found[name] = replace(known, place=place)
        return found

    def cursor(self, position: Position) -> Cursor:
        """What a place is in."""
        return cursor_at(self.source, *offset_of(position, self.source))

    def is_comment(self, position: Position) -> bool:
        """Whether a place is behind the `#` of a comment."""
        line, column = offset_of(position, self.source)
        before = _QUOTED.sub("", self.source.line(line + 1)[:column])
        return _COMMENT.search(before) is not None

    def declaration(self, known: Known) -> str:
        """The lines that declare a name of the text, the first of them."""
        for section in self.outline:
            for heading in section.entries:
                if heading.line == known.place.line - 1 and known.place.file == self.source.path:
                    last = min(
                        heading.last_line, heading.line + _SHOWN - 1, self.source.line_count - 1
                    )
                    lines = range(heading.line, last + 1)
                    return textwrap.dedent(
                        "\n".join(self.source.line(n + 1) for n in lines)
                    ).rstrip()
        return ""

    def word(self, position: Position) -> Word | None:
        """The name at a place; None between names."""
        line, column = offset_of(position, self.source)
        text = self.source.line(line + 1)
        for found in _WORD.finditer(text):
            if found.start() <= column <= found.end():
                dot = text.find(".", column, found.end())
                end = found.end() if dot < 0 else dot
                return Word(normalised(text[found.start() : end]), line, found.start(), end)
        return None


def span_of(heading: Heading, source: SourceText) -> Span:
    """The place of a key."""
    line = heading.line + 1
    return Span(
        file=source.path,
        line=line,
        column=heading.column + 1,
        end_line=line,
        end_column=heading.end_column + 1,
    )
