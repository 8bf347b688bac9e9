"""Defines places in files: source texts, spans that point into them, and printable text."""

import re
from bisect import bisect_right
from dataclasses import replace
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


# C0, DEL and C1; the ends of lines and paragraphs; marks of direction
_CODES = (
    *range(0x20),
    *range(0x7F, 0xA0),
    *(0x2028, 0x2029),
    *(0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)),
)
_IN_A_LINE = dict.fromkeys(_CODES, "�")
_IN_A_TEXT = {code: "�" for code in _CODES if chr(code) not in "\t\n\r"}
_IN_JSON = {code: f"\\u{code:04x}" for code in _CODES if code >= 0x20}


def printable(text: str) -> str:
    """A line with each control character replaced by one character, so that columns are
    preserved.
    """
    return text.translate(_IN_A_LINE)


def printable_json(text: str) -> str:
    """JSON text without control characters that JSON does not escape."""
    return text.translate(_IN_JSON)


def printable_source(source: SourceText) -> SourceText:
    """A file's name and text without control characters, except tabs and line ends."""
    return SourceText(printable(source.path), source.text.translate(_IN_A_TEXT))


def printable_span(span: Span) -> Span:
    """A span with control characters removed from the file name."""
    return replace(span, file=printable(span.file))
