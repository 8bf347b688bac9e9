"""Keeps names and texts of files from steering a terminal or the log of a pipeline.

A line feed in the name of a file would begin a line of the log, which CI may take for a command; a
control character moves the cursor, and a mark of direction shows a text in another order than it
has. Each is shown as `�`; in JSON it is escaped.
"""

from dataclasses import replace

from spec_schema.diagnostics.source import SourceText, Span

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
