"""Parses JSON text to values, with the place of each."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from msnn.features.nnodely.errors import not_json
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.source import SourceText, Span

LARGEST = 64_000_000
"""Maximum characters of a file."""
DEEPEST = 32
"""Maximum nesting; a saved model has seven levels."""
_FURTHEST_PLACE = 6
"""Depth up to which places of values are recorded."""
_FURTHEST_ELEMENT = 64
"""List elements whose places are recorded; later faults are located at the list."""
MOST_VALUES = 4_000_000
"""Maximum number of values: a file of empty lists needs thirty times its size in memory."""
_BLANK = re.compile(r"[ \t\n\r]*")
_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?")
_WORD = re.compile(r"[A-Za-z_+-]+|.", re.DOTALL)
# possessive: what could be tried again is kept for every character of a text that is long
_STRING = re.compile(r'"((?:[^"\\\x00-\x1f]++|\\.)*+)"', re.DOTALL)
_WORDS = {"true": True, "false": False, "null": None}

Path: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class JsonText:
    """The values of a JSON text, and the offsets (start, end) of each by its path of keys and
    indices.
    """

    value: Any
    source: SourceText
    places: Mapping[Path, tuple[int, int]]

    def place(self, *path: str | int) -> Span:
        """The place in the file of the value at a path, or of the nearest enclosing value whose
        place is known; of several lines the first.
        """
        while path and path not in self.places:
            path = path[:-1]
        start, end = self.places[path]
        return self.source.span(start, min(end, start + _first_line(self.source.text, start)))


def read_json(text: str, name: str) -> JsonText:
    """The values of a JSON text; `name` is the file in messages. Raises SpecError for invalid JSON,
    duplicate keys, NaN and infinity, and texts that are too large.
    """
    reader = _Reader(SourceText(name, text))
    if len(text) > LARGEST:
        raise reader.refused(0, f"it has more than {LARGEST:,} characters", "")
    # a byte order mark, which some editors on Windows write
    start = 1 if text.startswith("\ufeff") else 0
    value, end = reader.value(reader.blank(start), ())
    end = reader.blank(end)
    if end < len(text):
        raise reader.refused(end, "something follows the end of the model", "not expected here")
    return JsonText(value, reader.source, reader.places)


def path_text(path: Path) -> str:
    """A path as text: `Relations.Fir8[1]`."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text or "the top"


def _first_line(text: str, start: int) -> int:
    end = text.find("\n", start)
    return max((len(text) if end < 0 else end) - start, 1)


class _Reader:
    def __init__(self, source: SourceText) -> None:
        self.source = source
        self.places: dict[Path, tuple[int, int]] = {}
        self.count = 0

    def refused(self, offset: int, reason: str, label: str) -> SpecError:
        place = self.source.span(offset, offset + 1)
        return SpecError([not_json(self.source.path, reason, label, place)], [self.source])

    def blank(self, at: int) -> int:
        found = _BLANK.match(self.source.text, at)
        return at if found is None else found.end()

    def value(self, at: int, path: Path) -> tuple[Any, int]:
        text = self.source.text
        # the reader calls itself: a bound far below Python's stack
        if len(path) > DEEPEST:
            raise self.refused(at, f"it is nested more than {DEEPEST} deep", "one level too many")
        # counted as they are read: memory is bounded while it grows, not afterwards
        self.count += 1
        if self.count > MOST_VALUES:
            raise self.refused(at, f"it has more than {MOST_VALUES:,} values", "one too many")
        sign = text[at : at + 1]
        if sign == "{":
            value, end = self._object(at, path)
        elif sign == "[":
            value, end = self._list(at, path)
        elif sign == '"':
            value, end = self._string(at)
        else:
            value, end = self._number_or_word(at)
        step = path[-1] if path else ""
        # a place for each of a million weights would take more memory than the weights
        is_far = isinstance(step, int) and step >= _FURTHEST_ELEMENT
        if len(path) <= _FURTHEST_PLACE and not is_far:
            self.places[path] = (at, end)
        return value, end

    def _string(self, at: int) -> tuple[str, int]:
        found = _STRING.match(self.source.text, at)
        if found is None:
            raise self.refused(at, "a text is not closed", "it begins here")
        if "\\" not in found[1]:
            return found[1], found.end()
        try:
            # escapes and surrogate pairs are the standard library's business
            return str(json.loads(found[0])), found.end()
        except json.JSONDecodeError as fault:
            raise self.refused(at + fault.pos, f"a text is faulty: {fault.msg}", "here") from None

    def _number_or_word(self, at: int) -> tuple[Any, int]:
        found = _NUMBER.match(self.source.text, at)
        if found is not None:
            digits = found[0]
            # int() of very many digits is quadratic in their number; 18 fit in 64 bits
            value = int(digits) if digits.lstrip("-").isdecimal() and len(digits) < 19 else None
            value = float(digits) if value is None else value
            if not math.isfinite(value):
                raise self.refused(at, "a number is beyond what a double holds", "too large")
            return value, found.end()
        word = _WORD.match(self.source.text, at)
        if word is None:
            raise self.refused(at, "it ends in the middle of a value", "a value is missing")
        if word[0] not in _WORDS:
            nan = word[0].lower() in {"nan", "inf", "-inf", "infinity", "-infinity"}
            reason = f"`{word[0]}` is no value" if nan else "a value is missing or faulty"
            label = "training diverged: no model is in the file" if nan else "no JSON value"
            raise self.refused(at, reason, label)
        return _WORDS[word[0]], word.end()

    def _list(self, at: int, path: Path) -> tuple[list[Any], int]:
        values: list[Any] = []
        end = self.blank(at + 1)
        if self.source.text[end : end + 1] == "]":
            return values, end + 1
        while True:
            value, end = self.value(end, (*path, len(values)))
            values.append(value)
            end = self.blank(end)
            sign = self.source.text[end : end + 1]
            if sign == "]":
                return values, end + 1
            if sign != ",":
                raise self.refused(end, "a list is not closed", "`,` or `]` is missing")
            end = self.blank(end + 1)

    def _object(self, at: int, path: Path) -> tuple[dict[str, Any], int]:
        values: dict[str, Any] = {}
        end = self.blank(at + 1)
        if self.source.text[end : end + 1] == "}":
            return values, end + 1
        while True:
            if self.source.text[end : end + 1] != '"':
                raise self.refused(end, "a key is missing", "a key in double quotes goes here")
            start = end
            key, end = self._string(end)
            # json.loads would keep the last of two: which one was meant nobody knows
            if key in values:
                raise self.refused(start, f"the key `{key}` stands twice", "the second one")
            end = self.blank(end)
            if self.source.text[end : end + 1] != ":":
                raise self.refused(end, "a key has no value", "`:` is missing")
            values[key], end = self.value(self.blank(end + 1), (*path, key))
            end = self.blank(end)
            sign = self.source.text[end : end + 1]
            if sign == "}":
                return values, end + 1
            if sign != ",":
                raise self.refused(end, "an object is not closed", "`,` or `}` is missing")
            end = self.blank(end + 1)
