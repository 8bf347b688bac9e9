"""Wraps long lines of C."""

from __future__ import annotations

import textwrap

from backends.c_language.comments import comment_text

WIDTH = 100
_STEP = "    "
_SHORTEST = 30
"""Minimum number of columns of the first part of a wrapped line."""


def comment(text: str, indent: str = "") -> str:
    """A block comment of one or more lines; any text is safe."""
    width = WIDTH - len(indent) - len("/*  */")
    # no break at hyphens, which occur in file names and as minus
    lines = textwrap.wrap(comment_text(text), width, break_on_hyphens=False) or [""]
    return f"\n{indent} * ".join([f"{indent}/* {lines[0]}", *lines[1:]]) + " */"


def wrapped(line: str) -> list[str]:
    """Splits the line into parts of at most WIDTH characters, where spaces allow it.

    It breaks at the last place with the fewest open parentheses.
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
    """Position of the space to break at, never inside a string; None if there is none."""
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
    """At a space before an operator or after a comma."""
    if line[position] != " ":
        return False
    operator = line[position + 1 :].split(" ", 1)[0]
    return line[position - 1] == "," or operator in _OPERATORS


_OPERATORS = frozenset(("+", "-", "*", "/", "<", "<=", ">", ">=", "&&", "||", "&", "?", ":"))
