"""Makes any text of a spec safe inside C comments and string literals."""

from __future__ import annotations

from backends.ports.identifiers import ascii_text


def comment_text(text: str) -> str:
    """One line of printable ASCII that cannot end the comment or continue it.

    >>> comment_text('x */ #error\\n y')
    'x * / #error y'
    """
    plain = _printable(text)
    for ending, harmless in (("\\", "/"), ("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
        # a replacement may form a new pair with its neighbour, as in `**//`
        while ending in plain:
            plain = plain.replace(ending, harmless)
    # a slash at an end could join the comment's own delimiters
    return plain.strip().strip("/").strip()


def string_literal(text: str) -> str:
    """A C string literal of the text, in printable ASCII."""
    escaped = _printable(text).replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{escaped}"'


def string_size(text: str) -> int:
    """Size of that literal in bytes, with its terminating zero."""
    return len(_printable(text)) + 1


def _printable(text: str) -> str:
    visible = "".join(c if not c.isascii() or c.isprintable() else " " for c in text)
    return " ".join(ascii_text(visible).split())
