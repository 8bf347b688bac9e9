"""Converts spans to editor positions, which count UTF-16 code units from zero."""

from __future__ import annotations

from dataclasses import dataclass

from spec_schema.diagnostics.source import SourceText, Span

# what lies beyond is a surrogate pair in UTF-16, as the protocol counts by default
_LAST_OF_ONE_UNIT = 0xFFFF


@dataclass(frozen=True, slots=True, order=True)
class Position:
    """A position between two characters: line and UTF-16 code unit, both from zero."""

    line: int
    character: int


@dataclass(frozen=True, slots=True)
class TextRange:
    """A range of a text between two positions; `end` is exclusive."""

    start: Position
    end: Position

    def touches(self, other: TextRange) -> bool:
        """True if the ranges overlap or touch."""
        return self.start <= other.end and other.start <= self.end


START = TextRange(Position(0, 0), Position(0, 0))
"""Range for items without a place."""


def range_of(span: Span, source: SourceText | None) -> TextRange:
    """The range of a span in the text `source` of its file. If `source` is None, each character
    counts as one unit.
    """
    return TextRange(
        _position(span.line, span.column, source), _position(span.end_line, span.end_column, source)
    )


def offset_of(position: Position, source: SourceText) -> tuple[int, int]:
    """Line and column of a position in characters from zero; a position beyond the text becomes its
    end or that of the line.
    """
    # an editor may ask about a text that it has changed meanwhile
    if position.line >= source.line_count:
        line = source.line_count - 1
        return line, len(source.line(line + 1))
    text = source.line(position.line + 1)
    units = 0
    for column, character in enumerate(text):
        if units >= position.character:
            return position.line, column
        units += _units(character)
    return position.line, len(text)


def position_of(line: int, column: int, source: SourceText) -> Position:
    """The position for a line and column in characters from zero."""
    return _position(line + 1, column + 1, source)


def _position(line: int, column: int, source: SourceText | None) -> Position:
    if source is None or line > source.line_count:
        return Position(line - 1, column - 1)
    before = source.line(line)[: column - 1]
    units = len(before) if before.isascii() else sum(map(_units, before))
    return Position(line - 1, units)


def _units(character: str) -> int:
    return 2 if ord(character) > _LAST_OF_ONE_UNIT else 1
