"""Defines places in files: source texts, and spans that point into them."""

import re
from bisect import bisect_right
from functools import cached_property

from spec_schema.late_dataclass import dataclass

_LINE_END = re.compile(r"\r\n?|\n")


@dataclass(frozen=True, slots=True, order=True, kw_only=True)
class Span:
    """A range of a file: 1-based lines and columns in characters, exclusive end."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int

    def to(self, other: "Span") -> "Span":
        """The span from the start of this one to the end of `other`."""
        return Span(
            file=self.file,
            line=self.line,
            column=self.column,
            end_line=other.end_line,
            end_column=other.end_column,
        )


@dataclass(frozen=True)
class SourceText:
    """A file's name and text; turns character offsets into spans.

    Lines end at LF, CR LF or CR, as editors count them.
    """

    path: str
    text: str

    @cached_property
    def _starts(self) -> tuple[int, ...]:
        return (0, *(found.end() for found in _LINE_END.finditer(self.text)))

    @property
    def line_count(self) -> int:
        """The number of lines of the text; an empty text has one."""
        return len(self._starts)

    def span(self, start: int, end: int) -> Span:
        """The span of `text[start:end]`; offsets beyond the text are moved to its end."""
        line, column = self.position(start)
        # a span never ends before it starts, even where a parser says so
        end_line, end_column = self.position(max(start, end))
        return Span(
            file=self.path, line=line, column=column, end_line=end_line, end_column=end_column
        )

    def position(self, offset: int) -> tuple[int, int]:
        """1-based line and column of a character offset."""
        offset = min(max(offset, 0), len(self.text))
        # the last line that starts at or before the offset
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1

    def line(self, number: int) -> str:
        """The text of a 1-based line, without its line end."""
        start = self._starts[number - 1]
        end = self._starts[number] if number < self.line_count else len(self.text)
        # both: the line end may have two characters
        return self.text[start:end].rstrip("\r\n")
