"""Defines diagnostics, and formats them in full: code, place, source lines, notes, help."""

import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Literal, Protocol, TypeAlias, TypedDict, Unpack

from spec_schema.diagnostics.source import (
    SourceText,
    Span,
    printable,
    printable_source,
    printable_span,
)
from spec_schema.late_dataclass import dataclass

Severity: TypeAlias = Literal["error", "warning", "note"]
Secondary: TypeAlias = tuple[tuple[Span, str], ...]


@dataclass(frozen=True, kw_only=True)
class Diagnostic:
    """One message with a stable code.

    `span` is the smallest place at fault and `label` stands under its underline; `secondary` are
    further places with their labels. Notes are facts, `help` is the repair; where that is other
    words at `span` and nothing else, `replacement` has them, for editors. Only the constructors in
    `spec_schema.errors` and `msnn.errors` build diagnostics, by `error`, `warning` and `remark`, so
    that each sentence is written once.
    """

    code: str
    severity: Severity
    message: str
    span: Span | None
    label: str = ""
    secondary: Secondary = ()
    notes: tuple[str, ...] = ()
    help: str | None = None
    replacement: str | None = None

    def also_in(self, files: int) -> "Diagnostic":
        """The same diagnostic with a note that it applies to that many further files."""
        more = f" … and {files} more file{'s' if files > 1 else ''}"
        # of a mistake in each of a thousand files one message is enough
        return replace(self, message=self.message + more) if files else self

    def seen_from(self, place: Span, label: str) -> "Diagnostic":
        """The same diagnostic with a further place and its label."""
        return replace(self, secondary=(*self.secondary, (place, label)))

    @property
    def printable(self) -> "Diagnostic":
        """The same diagnostic without control characters, which quoted files may contain."""
        return replace(
            self,
            message=printable(self.message),
            span=self.span and printable_span(self.span),
            label=printable(self.label),
            secondary=tuple((printable_span(s), printable(text)) for s, text in self.secondary),
            notes=tuple(printable(note) for note in self.notes),
            help=self.help and printable(self.help),
        )


class Facts(TypedDict, total=False):
    """The optional parts of a diagnostic, as keyword arguments: further places, notes, help,
    replacement.
    """

    secondary: Secondary
    notes: tuple[str, ...]
    help: str | None
    replacement: str | None


def error(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of an error, which ends its stage."""
    return Diagnostic(code=code, severity="error", message=message, span=span, label=label, **facts)


def warning(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of a warning, after which its stage continues."""
    return Diagnostic(
        code=code, severity="warning", message=message, span=span, label=label, **facts
    )


def remark(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of a note about something that may be intended."""
    return Diagnostic(code=code, severity="note", message=message, span=span, label=label, **facts)


class SpecError(Exception):
    """A spec, data or weights are wrong; the exception has every diagnostic, warnings included.

    `sources` are the texts that the diagnostics point into, as far as they are known.
    """

    def __init__(
        self, diagnostics: Iterable[Diagnostic], sources: Iterable[SourceText] = ()
    ) -> None:
        self.diagnostics = tuple(diagnostics)
        self.sources = tuple(sources)
        # for whoever prints the exception itself, as `pytest` and logs do
        super().__init__("; ".join(describe(diagnostic) for diagnostic in self.diagnostics))

    def __reduce__(self) -> tuple[type[Exception], tuple[object, ...]]:
        """Pickles the exception by its diagnostics, so that a process pool can return it."""
        return SpecError, (self.diagnostics, self.sources)

    def _render_traceback_(self) -> list[str]:
        """Shows the complete message in a notebook instead of a traceback."""
        return shown_whole(self.diagnostics, self.sources)


def shown_whole(diagnostics: Iterable[Diagnostic], sources: Iterable[SourceText] = ()) -> list[str]:
    """The lines for IPython: places, source lines and help, in colour."""
    return in_full([found.printable for found in diagnostics], sources, color=True).splitlines()


def describe(diagnostic: Diagnostic) -> str:
    """One line in the format of compilers: `file:line:column: error[E0301]: message`."""
    span = diagnostic.span
    place = f"{span.file}:{span.line}:{span.column}: " if span else ""
    return printable(f"{place}{diagnostic.severity}[{diagnostic.code}]: {diagnostic.message}")


class Findings:
    """Collects the diagnostics of one stage, so that all are shown together."""

    def __init__(self) -> None:
        # a dict keeps the order of reports and drops what is equal: a set would lose the order
        self._diagnostics: dict[Diagnostic, None] = {}

    def report(self, *diagnostics: Diagnostic) -> None:
        """Adds diagnostics without duplicates, e.g. from an alias that is read twice."""
        self._diagnostics.update(dict.fromkeys(diagnostics))

    def mark(self) -> int:
        """The number of diagnostics so far; an argument of `since` and `forget`."""
        return len(self._diagnostics)

    def since(self, mark: int) -> tuple[Diagnostic, ...]:
        """The diagnostics added after a mark."""
        return tuple(self._diagnostics)[mark:]

    def forget(self, mark: int) -> None:
        """Removes the diagnostics after a mark, if an attempt failed and another one follows."""
        # what is reported again after `mark` kept its first place, and stays
        for diagnostic in list(self._diagnostics)[mark:]:
            del self._diagnostics[diagnostic]

    @property
    def in_order(self) -> tuple[Diagnostic, ...]:
        """All diagnostics in the order of their places; those without a place are last."""
        return tuple(sorted(self._diagnostics, key=_place))

    @property
    def failed(self) -> bool:
        """True if there is an error."""
        return any(diagnostic.severity == "error" for diagnostic in self._diagnostics)

    def raise_errors(self) -> None:
        """Raises SpecError with all diagnostics if there is an error."""
        if self.failed:
            raise SpecError(self.in_order)


def _place(diagnostic: Diagnostic) -> tuple[bool, str, int, int]:
    span = diagnostic.span
    # False sorts before True: what has no place follows what has one
    return (False, span.file, span.line, span.column) if span else (True, "", 0, 0)


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
    """A diagnostic as it is printed, without control characters."""

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
    """All underlines of a diagnostic: those in the file of its main place first, sorted by line."""
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
