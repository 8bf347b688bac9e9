"""Keeps what stands in files from steering a terminal: control characters are shown as `�`."""

from dataclasses import replace

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import SourceText, Span

# C0 without tab, line feed and carriage return, which are layout; DEL; C1
_CODES = [code for code in range(0xA0) if code < 0x20 or code >= 0x7F]
_SHOWN = {code: "�" for code in _CODES if chr(code) not in "\t\n\r"}


def printable(text: str) -> str:
    """The text with one sign for each control character, so that columns stay what they are."""
    return text.translate(_SHOWN)


def printable_source(source: SourceText) -> SourceText:
    """A file's name and text as they may be printed."""
    return SourceText(printable(source.path), printable(source.text))


def printable_diagnostic(diagnostic: Diagnostic) -> Diagnostic:
    """A diagnostic as it may be printed: its sentences may quote a file."""
    return replace(
        diagnostic,
        message=printable(diagnostic.message),
        span=diagnostic.span and _span(diagnostic.span),
        label=printable(diagnostic.label),
        secondary=tuple((_span(span), printable(text)) for span, text in diagnostic.secondary),
        notes=tuple(printable(note) for note in diagnostic.notes),
        help=diagnostic.help and printable(diagnostic.help),
    )


def _span(span: Span) -> Span:
    return replace(span, file=printable(span.file))
