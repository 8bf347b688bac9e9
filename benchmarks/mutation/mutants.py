"""Puts faults into generated C, one at a time, by class of fault."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutation.last_digits import last_digits
from benchmarks.mutation.memory_faults import deleted, raw_samples, shared_memory, static_locals

Change = tuple[int, int, str]
"""Where a change begins and ends in a text, and what stands there instead."""

_REAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?)f\b")
_INDEX = re.compile(r"\[(\w+)( \+ 1U)?\]")
_BOUND = re.compile(r"< (\d+)U; ")
_SWAPS = ((" + ", " - "), (" - ", " + "), (" * ", " + "), (" / ", " * "), (" && ", " || "))
_COMPARISONS = {"<": ">=", ">": "<=", "<=": ">", ">=": "<"}
_COMPARISON = re.compile(r" (<=|>=|<|>) (?!\d+U; )")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_BODY = re.compile(r"^[^\n#/{}]*\([^;{}]*\)\n\{\n(.*?)^\}", re.DOTALL | re.MULTILINE)
_HEADER = re.compile(r"^[^\n#/{} ][^\n#/{}(]*?(\w+)\([^;{}]*\)\n\{", re.MULTILINE)
_DEFINITION = re.compile(r"^const \w+_real \w+_sample_time = (.*?)f?;", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Mutant:
    """A source with one fault: the changed text, its line and its class."""

    kind: str
    file: str
    function: str
    """In which the change begins; empty outside of all."""
    text: str
    line: str
    """Where a bit of the status is set, with its condition."""
    change: str
    """What becomes what, and the how manyth of the line where more than one can."""


def mutants(export: Path, prefix: str) -> Iterator[Mutant]:
    """Yields every fault in the sources of a model, except its self-test and trained values."""
    for end, classes in _FILES.items():
        path = export / "src" / f"{prefix}{end}.c"
        if path.is_file():
            source = path.read_text(encoding="utf-8")
            for kind, changes in classes.items():
                yield from _mutants(kind, path.name, source, changes)


_SEEN_SQUARED = 0.1
"""Added to constants of kernels, where a 0 may stand for an error whose square is summed."""


def value_mutants(source: str) -> Iterator[Mutant]:
    """Yields faults in other C: constants, indices, bounds, signs and comparisons."""
    yield from _mutants("value", "", source, lambda code: _values(code, _SEEN_SQUARED))


def last_digit_mutants(source: str) -> Iterator[Mutant]:
    """Yields faults in the last digit of constants of mathematical functions."""
    yield from _mutants("last digit", "", source, last_digits)


def _mutants(
    kind: str, file: str, source: str, changes: Callable[[str], Iterator[tuple[Change, ...]]]
) -> Iterator[Mutant]:
    code = _COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), source)
    every = sorted(set(changes(code)))
    told = [_line_and_change(source, places[0]) for places in every]
    count: dict[tuple[int, str], int] = {}
    for places, (here, line, change) in zip(every, told, strict=True):
        same = [other for other in told if (other[0], other[2]) == (here, change)]
        count[here, change] = count.get((here, change), 0) + 1
        if len(same) > 1:
            change = f"{change} ({count[here, change]})"
        text = source
        for first, last, other in sorted(places, reverse=True):
            text = text[:first] + other + text[last:]
        yield Mutant(kind, file, _function(code, places[0][0]), text, line, change)


def _line_and_change(source: str, place: Change) -> tuple[int, str, str]:
    """The start of the changed line, its text, and the change in words."""
    begin, end, instead = place
    here = source.rfind("\n", 0, begin)
    line = source[here + 1 : source.find("\n", begin)].strip()
    if line.startswith("status |= "):
        line = f"{source[source.rfind(chr(10), 0, here) + 1 : here].strip()} {line}"
    return here, line, " ".join(f"{source[begin:end].strip()} -> {instead.strip()}".split())


def _function(code: str, place: int) -> str:
    names = [match[1] for match in _HEADER.finditer(code, 0, place)]
    return names[-1] if names else ""


def _values(code: str, added: float = 0.001) -> Iterator[tuple[Change, ...]]:
    """Yields changes of constants by 1 %, and of indices, bounds, signs and comparisons."""
    for body in _BODY.finditer(code):
        for begin, end, instead in _values_of(body[1], added):
            yield ((body.start(1) + begin, body.start(1) + end, instead),)


def _values_of(code: str, added: float) -> Iterator[Change]:
    for match in _REAL.finditer(code):
        value = float(match[1])
        yield match.start(), match.end(), f"{value * 1.01 + added!r}f"
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


def _sample_time(code: str) -> Iterator[tuple[Change, ...]]:
    """Yields changes of the sample time: slightly longer, and much longer."""
    for match in _DEFINITION.finditer(code):
        for factor in (1.000001, 2.0):
            yield ((match.start(1), match.end(1), repr(float(match[1]) * factor)),)


_FILES: dict[str, dict[str, Callable[[str], Iterator[tuple[Change, ...]]]]] = {
    "": {
        "value": _values,
        "deleted": deleted,
        "raw": raw_samples,
        "shared": shared_memory,
        "static": static_locals,
    },
    "_about": {"sample time": _sample_time},
    "_math": {"last digit": last_digits},
}
"""Classes of faults by the end of a file's name."""
