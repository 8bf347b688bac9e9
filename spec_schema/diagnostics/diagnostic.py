"""Defines a message to the user as data, independent of its format."""

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
        """The same message with the number of further files it applies to."""
        more = f" … and {files} more file{'s' if files > 1 else ''}"
        # of a mistake in each of a thousand files one message is enough
        return replace(self, message=self.message + more) if files else self

    def seen_from(self, place: Span, label: str) -> "Diagnostic":
        """The same message with a further place."""
        return replace(self, secondary=(*self.secondary, (place, label)))

    @property
    def printable(self) -> "Diagnostic":
        """The same message with control characters of quoted files removed."""
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
        """The current number of diagnostics, as argument for `forget`."""
        return len(self._diagnostics)

    def since(self, mark: int) -> tuple[Diagnostic, ...]:
        """The diagnostics added after a mark."""
        return tuple(self._diagnostics)[mark:]

    def forget(self, mark: int) -> None:
        """Removes the diagnostics after a mark, for a failed attempt without consequences."""
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
