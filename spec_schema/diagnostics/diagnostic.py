"""Holds what a user is told about a spec as data, apart from how it is printed."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, TypeAlias, TypedDict, Unpack

from spec_schema.diagnostics.printable import printable, printable_span
from spec_schema.diagnostics.render_full import in_full
from spec_schema.diagnostics.source import SourceText, Span
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
        """The same said of so many more files."""
        more = f" … and {files} more file{'s' if files > 1 else ''}"
        # of a mistake in each of a thousand files one message is enough
        return replace(self, message=self.message + more) if files else self

    def seen_from(self, place: Span, label: str) -> "Diagnostic":
        """The same with one further place, to which it matters."""
        return replace(self, secondary=(*self.secondary, (place, label)))

    @property
    def printable(self) -> "Diagnostic":
        """The same as it may be printed: its sentences may quote a file."""
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
    """The parts of a message beside its sentence, as `Diagnostic` has them."""

    secondary: Secondary
    notes: tuple[str, ...]
    help: str | None
    replacement: str | None


def error(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of a fault, which ends its stage."""
    return Diagnostic(code=code, severity="error", message=message, span=span, label=label, **facts)


def warning(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of a doubt, with which its stage goes on."""
    return Diagnostic(
        code=code, severity="warning", message=message, span=span, label=label, **facts
    )


def remark(
    code: str, span: Span | None, message: str, label: str = "", **facts: Unpack[Facts]
) -> Diagnostic:
    """Builds the diagnostic of what is worth a thought and may well be meant: a note."""
    return Diagnostic(code=code, severity="note", message=message, span=span, label=label, **facts)


class SpecError(Exception):
    """A stage failed; carries every diagnostic of that stage, warnings included.

    `sources` are the texts that spans point into, where the one who raises it has them.
    """

    def __init__(
        self, diagnostics: Iterable[Diagnostic], sources: Iterable[SourceText] = ()
    ) -> None:
        self.diagnostics = tuple(diagnostics)
        self.sources = tuple(sources)
        # for whoever prints the exception itself, as `pytest` and logs do
        super().__init__("; ".join(describe(diagnostic) for diagnostic in self.diagnostics))

    def __reduce__(self) -> tuple[type[Exception], tuple[object, ...]]:
        """Crosses to another process as its diagnostics: a pool waits for ever on what cannot."""
        return SpecError, (self.diagnostics, self.sources)

    def _render_traceback_(self) -> list[str]:
        """Shows the command line's message, whole, in a notebook in place of a traceback."""
        return shown_whole(self.diagnostics, self.sources)


def shown_whole(diagnostics: Iterable[Diagnostic], sources: Iterable[SourceText] = ()) -> list[str]:
    """The lines that IPython asks an exception for: places, source lines and help, in colour."""
    return in_full([found.printable for found in diagnostics], sources, color=True).splitlines()


def describe(diagnostic: Diagnostic) -> str:
    """One line: `file:line:column: error[E0301]: message`, as compilers print it."""
    span = diagnostic.span
    place = f"{span.file}:{span.line}:{span.column}: " if span else ""
    return printable(f"{place}{diagnostic.severity}[{diagnostic.code}]: {diagnostic.message}")


class Findings:
    """Collects the diagnostics of one stage, so that a user sees all of them at once."""

    def __init__(self) -> None:
        # a dict keeps the order of reports and drops what is equal: a set would lose the order
        self._diagnostics: dict[Diagnostic, None] = {}

    def report(self, *diagnostics: Diagnostic) -> None:
        """Adds diagnostics; one that is there already (an alias read twice) is not repeated."""
        self._diagnostics.update(dict.fromkeys(diagnostics))

    def mark(self) -> int:
        """The number of diagnostics so far; `forget` goes back to it."""
        return len(self._diagnostics)

    def since(self, mark: int) -> tuple[Diagnostic, ...]:
        """The diagnostics that came after a mark."""
        return tuple(self._diagnostics)[mark:]

    def forget(self, mark: int) -> None:
        """Drops what came after a mark: an attempt that failed and does not matter."""
        # what is reported again after `mark` kept its first place, and stays
        for diagnostic in list(self._diagnostics)[mark:]:
            del self._diagnostics[diagnostic]

    @property
    def in_order(self) -> tuple[Diagnostic, ...]:
        """All diagnostics in the order of their places in the file; those without one come last."""
        return tuple(sorted(self._diagnostics, key=_place))

    @property
    def failed(self) -> bool:
        """Whether an error is among them."""
        return any(diagnostic.severity == "error" for diagnostic in self._diagnostics)

    def raise_errors(self) -> None:
        """Raises SpecError with everything found if an error is among it."""
        if self.failed:
            raise SpecError(self.in_order)


def _place(diagnostic: Diagnostic) -> tuple[bool, str, int, int]:
    span = diagnostic.span
    # False sorts before True: what has no place follows what has one
    return (False, span.file, span.line, span.column) if span else (True, "", 0, 0)
