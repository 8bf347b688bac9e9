"""Makes texts of a spec harmless inside C comments and string literals, whatever they hold."""

from __future__ import annotations

from backends.ports.identifiers import ascii_text


def comment_text(text: str) -> str:
    """One line of printable ASCII that can neither end the comment nor continue it.

    >>> comment_text('x */ #error\\n y')
    'x * / #error y'
    """
    plain = _printable(text)
    for ending, harmless in (("\\", "/"), ("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
        # a repair may make a new pair with its neighbour, as in `**//`
        while ending in plain:
            plain = plain.replace(ending, harmless)
    # the comment's own delimiters stand beside the text
    return plain.strip().strip("/").strip()


def string_literal(text: str) -> str:
    """A C string literal with the text in printable ASCII."""
    escaped = _printable(text).replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{escaped}"'


def string_size(text: str) -> int:
    """Bytes of that literal with its terminating zero."""
    return len(_printable(text)) + 1


def _printable(text: str) -> str:
    visible = "".join(c if not c.isascii() or c.isprintable() else " " for c in text)
    return " ".join(ascii_text(visible).split())
