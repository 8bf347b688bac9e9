"""Formats a diagnostic in full: code, place, underlined source lines, notes and help."""

import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

from spec_schema.diagnostics.printable import printable_source
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.late_dataclass import dataclass

_COLORS: Mapping[str, str] = {"error": "1;31", "warning": "1;33", "note": "1;32"}
_FRAME = "1;34"
_TAB = "    "
_CUT = "…"
_LONGEST_LINE = 160


@dataclass(frozen=True)
class _Mark:
    """An underline, its label, and the character and colour it is drawn with."""

    span: Span
    label: str
    drawn: str
    color: str


class Told(Protocol):
    """The displayed parts of a diagnostic, without control characters."""

    @property
    def code(self) -> str: ...
    @property
    def severity(self) -> str: ...
    @property
    def message(self) -> str: ...
    @property
    def span(self) -> Span | None: ...
    @property
    def label(self) -> str: ...
    @property
    def secondary(self) -> tuple[tuple[Span, str], ...]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def help(self) -> str | None: ...


def in_full(told: Iterable[Told], sources: Iterable[SourceText], *, color: bool) -> str:
    """All diagnostics, separated by empty lines; `sources` are the files whose lines are shown."""
    # whole files at once: a name or a line can hold what would steer the terminal
    texts = {source.path: source for source in map(printable_source, sources)}
    return "\n\n".join(_full_text(each, texts, color) for each in told)


def _full_text(diagnostic: Told, texts: Mapping[str, SourceText], color: bool) -> str:
    """The diagnostic in the layout of rustc; `texts` are the sources by name."""
    main = diagnostic.span
    marks = [] if main is None else _marks(diagnostic, main)
    # wide enough for the largest line number, so that the bars stand in one column
    width = max((len(str(mark.span.line)) for mark in marks), default=0)
    page = _Page(texts, width, color)
    severity = diagnostic.severity
    title = page.paint(f"{severity}[{diagnostic.code}]", _COLORS[severity])
    lines = [title + page.paint(f": {diagnostic.message}", "1")]
    if main is not None:
        arrow = page.paint(" " * width + "-->", _FRAME)
        lines.append(f"{arrow} {main.file}:{main.line}:{main.column}")
        lines.extend(page.excerpts(main, marks))
    sign = page.paint(" " * (width + 1) + "=", _FRAME)
    lines.extend(f"{sign} note: {note}" for note in diagnostic.notes)
    if diagnostic.help is not None:
        lines.append(f"{sign} help: {diagnostic.help}")
    return "\n".join(lines)


def _marks(diagnostic: Told, main: Span) -> list[_Mark]:
    """All underlines: first those in the main file, then by file and line."""
    marks = [_Mark(main, diagnostic.label, "^", _COLORS[diagnostic.severity])]
    marks.extend(_Mark(span, label, "-", _FRAME) for span, label in diagnostic.secondary)
    # False sorts before True: the main file comes first
    return sorted(marks, key=lambda mark: (mark.span.file != main.file, mark.span))


class _Page:
    def __init__(self, texts: Mapping[str, SourceText], width: int, color: bool) -> None:
        self.texts = texts
        self.margin = " " * (width + 1)
        self.color = color

    def paint(self, text: str, code: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self.color else text

    def excerpts(self, main: Span, marks: list[_Mark]) -> Iterator[str]:
        """Each marked source line with its underlines; `...` marks omitted lines."""
        file, shown, part = main.file, 0, slice(0, 0)
        for mark in marks:
            span = mark.span
            if span.file != file:
                file, shown = span.file, 0
                arrow = self.paint(f"{self.margin[:-1]}:::", _FRAME)
                yield f"{arrow} {file}:{span.line}:{span.column}"
            text = self.texts.get(file)
            if text is None or span.line > text.line_count:
                continue
            line = text.line(span.line)
            if span.line != shown:
                # two marks on a line share its excerpt, cut around the main one
                part = _shown_part(line, main if main.line == span.line else span)
                if shown == 0:
                    yield self.paint(f"{self.margin}|", _FRAME)
                elif span.line > shown + 1:
                    yield "..."
                number = str(span.line).rjust(len(self.margin) - 1)
                yield f"{self.paint(f'{number} |', _FRAME)} {_written(line, part)}".rstrip()
                shown = span.line
            # a mark beyond the part of a long line that is shown has nothing to underline
            if span.column - 1 <= part.stop:
                yield self.underline(mark, line, part)

    def underline(self, mark: _Mark, line: str, part: slice) -> str:
        """The width of an underline; a multi-line place is underlined to the end of its first
        line.
        """
        span = mark.span
        # a mark that begins before the part is underlined from the beginning of the part on
        first = max(span.column - 1, part.start)
        last = span.end_column - 1 if span.end_line == span.line else len(line)
        before = _columns(line[part.start : first]) + (len(_CUT) if part.start else 0)
        # an empty place still has a mark, one column wide
        drawn = mark.drawn * max(1, _columns(line[first : min(last, part.stop)]))
        said = f"{drawn} {mark.label}".rstrip()
        bar = self.paint(f"{self.margin}|", _FRAME)
        return f"{bar} {' ' * before}{self.paint(said, mark.color)}"


def _shown_part(line: str, span: Span) -> slice:
    """The complete line, or the part around the place if the line is very long."""
    if len(line) <= _LONGEST_LINE:
        return slice(0, len(line))
    # a quarter of the line before the place, the rest behind it
    start = max(0, span.column - 1 - _LONGEST_LINE // 4)
    return slice(start, min(len(line), start + _LONGEST_LINE))


def _written(line: str, part: slice) -> str:
    before = _CUT if part.start else ""
    after = _CUT if part.stop < len(line) else ""
    return before + line[part].replace("\t", _TAB).rstrip() + after


def _columns(text: str) -> int:
    """The number of terminal columns of a text."""
    return sum(_column_count(character) for character in text)


def _column_count(character: str) -> int:
    if character == "\t":
        return len(_TAB)
    # an accent of its own stands above the letter before it
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in {"W", "F"} else 1
