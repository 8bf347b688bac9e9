"""Changes generated C in one place at a time: constants, signs, indices, shifts, comparisons."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_REAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?)f\b")
_INDEX = re.compile(r"\[(\w+)( \+ 1U)?\]")
_BOUND = re.compile(r"< (\d+)U; ")
_SWAPS = ((" + ", " - "), (" - ", " + "), (" * ", " + "), (" / ", " * "), (" && ", " || "))
_COMPARISONS = {"<": ">=", ">": "<=", "<=": ">", ">=": "<"}
_COMPARISON = re.compile(r" (<=|>=|<|>) (?!\d+U; )")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_BODY = re.compile(r"^[^\n#/{}]*\([^;{}]*\)\n\{\n(.*?)^\}", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Mutant:
    """The changed source, and what was changed in which line."""

    text: str
    line: str
    change: str


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of the functions of a source."""
    for body in _BODY.finditer(source):
        code = _COMMENT.sub(lambda comment: " " * len(comment[0]), body[1])
        for begin, stop, instead in sorted(set(_changes(code))):
            a, b = body.start(1) + begin, body.start(1) + stop
            line = source[source.rfind("\n", 0, a) + 1 : source.find("\n", a)].strip()
            change = f"{source[a:b].strip()} -> {instead.strip()}"
            yield Mutant(source[:a] + instead + source[b:], line, change)


def _changes(code: str) -> Iterator[tuple[int, int, str]]:
    """Where a change begins and ends, and what stands there instead."""
    for match in _REAL.finditer(code):
        value = float(match[1])
        yield match.start(), match.end(), f"{value * 1.01 + 0.001!r}f"
    for match in _INDEX.finditer(code):
        if match[2]:
            yield match.start(2), match.end(2), ""
    for match in _BOUND.finditer(code):
        yield match.start(1), match.end(1), str(int(match[1]) - 1)
    for sign, other in _SWAPS:
        for match in re.finditer(re.escape(sign), code):
            if not re.match(r"\d+U\b", code[match.end() :]):
                yield match.start(), match.end(), other
    for match in _COMPARISON.finditer(code):
        yield match.start(1), match.end(1), _COMPARISONS[match[1]]
