"""Keeps what stands in files from steering a terminal: control characters are shown as `�`."""

from dataclasses import replace

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


def printable_span(span: Span) -> Span:
    """A place whose file's name may be printed."""
    return replace(span, file=printable(span.file))
