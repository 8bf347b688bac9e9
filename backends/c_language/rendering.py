"""Renders the text of C files: templates, comments of any text, wrapped lines."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any, Protocol

from backends.files.text_templates import text_templates
from backends.ports.identifiers import ascii_text


class Generated(Protocol):
    """Facts that every file of an export shows: name of the model, prefix of C names, and if
    functions have a pointer to parameters.
    """

    @property
    def model(self) -> str:
        """Name of the program."""
        ...

    @property
    def prefix(self) -> str: ...

    @property
    def takes_parameters(self) -> bool:
        """True if functions have a pointer to parameters."""
        ...


@dataclass(frozen=True, slots=True)
class GeneratedNames:
    """Name and prefix of an export whose C functions have no pointer to parameters."""

    model: str
    prefix: str
    takes_parameters: bool = False


_WITHOUT_JACOBIAN = {"jacobian": False, "letters": (), "vectors": (), "vector_functions": ()}
_WITHOUT_CALIBRATION = {"calibrates": False}


def render(template: str, interface: Generated, title: str, folder: str = "c", **facts: Any) -> str:
    """Renders `templates/<folder>/<template>` with names that all files need, and with `facts`.
    `title` is the file's purpose, for the comment at its top. Long lines of C files are wrapped.
    """
    prefix = interface.prefix
    banner = comment(f"{title} of the model `{interface.model}`. Made by msnn; do not edit.")
    common = {
        "banner": banner,
        "prefix": prefix,
        "macro": prefix.upper(),
        "takes_parameters": interface.takes_parameters,
        "params": f", &{prefix}_params_default" if interface.takes_parameters else "",
        **_WITHOUT_JACOBIAN,
        **_WITHOUT_CALIBRATION,
    }
    # facts of a file override the defaults; most files have no Jacobian and no calibration
    text = text_templates().get_template(f"{folder}/{template}").render(common | facts)
    if not template.endswith((".c.j2", ".h.j2")):
        return text
    return "\n".join(part for line in text.split("\n") for part in _fitted(line))


def _fitted(line: str) -> list[str]:
    """The line split into lines that are not too long; a preprocessor directive stays whole, as it
    ends with its line.
    """
    # a directive ends with its line
    return [line] if line.startswith("#") else wrapped(line)


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
    """A C string literal of the text in quotes. Characters other than printable ASCII are replaced,
    and spaces and line ends become single spaces.
    """
    escaped = _printable(text).replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    return f'"{escaped}"'


def string_size(text: str) -> int:
    """The size in bytes of `string_literal(text)` in memory, with the zero at its end."""
    return len(_printable(text)) + 1


def _printable(text: str) -> str:
    visible = "".join(c if not c.isascii() or c.isprintable() else " " for c in text)
    return " ".join(ascii_text(visible).split())


WIDTH = 100
_STEP = "    "
_SHORTEST = 30
"""Minimum number of columns of the first part of a wrapped line."""


def comment(text: str, indent: str = "") -> str:
    """A C comment with the text, wrapped to lines of 100 columns that begin with `indent`. No text
    can end the comment early.
    """
    width = WIDTH - len(indent) - len("/*  */")
    # no break at hyphens, which occur in file names and as minus
    lines = textwrap.wrap(comment_text(text), width, break_on_hyphens=False) or [""]
    return f"\n{indent} * ".join([f"{indent}/* {lines[0]}", *lines[1:]]) + " */"


def wrapped(line: str) -> list[str]:
    """Splits a line of C into lines of at most WIDTH characters, where spaces allow it. It breaks
    at the last place with the fewest open parentheses.
    """
    body = line.lstrip(" ")
    indent = line[: len(line) - len(body)]
    # comments can break at any space
    if len(line) > WIDTH and body.startswith("/*"):
        return comment(body.removeprefix("/*").removesuffix("*/"), indent).split("\n")
    parts: list[str] = []
    while len(line) > WIDTH:
        at = _break(line, len(indent) + (len(_STEP) if parts else 0))
        if at is None:
            break
        parts.append(line[:at])
        line = f"{indent}{_STEP}{line[at + 1 :]}"
    return [*parts, line]


def _break(line: str, start: int) -> int | None:
    """The position of the space at which to break the line, searched from `start` to WIDTH and
    never inside a string; None if there is none.
    """
    best: tuple[int, int] | None = None
    depth = 0
    quoted = False
    for position in range(start, WIDTH):
        character = line[position]
        if character == '"' and line[position - 1] != "\\":
            quoted = not quoted
        elif quoted:
            continue
        elif character in "([{":
            depth += 1
        elif character in ")]}":
            depth -= 1
        elif _may_break(line, position) and (
            best is None or depth <= best[0] or best[1] < start + _SHORTEST
        ):
            best = (depth, position)
    return None if best is None else best[1]


def _may_break(line: str, position: int) -> bool:
    """True for a space after a comma or before an operator."""
    if line[position] != " ":
        return False
    operator = line[position + 1 :].split(" ", 1)[0]
    return line[position - 1] == "," or operator in _OPERATORS


_OPERATORS = frozenset(("+", "-", "*", "/", "<", "<=", ">", ">=", "&&", "||", "&", "?", ":"))
