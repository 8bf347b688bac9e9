"""Reads values from untrusted parsed JSON, and reports the place of wrong ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

Read = TypeVar("Read")

# a double represents every integer up to this limit
_LARGEST_INTEGER = 1 << 53
_LONGEST_STRING = 1 << 20


class Malformed(Exception):  # noqa: N818  (carried to the reader's edge, where it becomes a Diagnostic)
    """A value is missing or of the wrong kind; the text says which."""


class PlainRecord:
    """A JSON object all of whose keys must be read; `place` is its path in the file."""

    def __init__(self, data: Any, place: str) -> None:
        if not isinstance(data, dict):
            raise Malformed(f"{place} is no object")
        self._data = cast("dict[str, Any]", data)
        self._read = set[str]()
        self.place = place

    def close(self) -> None:
        """Raises Malformed if a key has not been read."""
        for key in self._data:
            if key not in self._read:
                raise Malformed(f"{self.place} has the unknown key {key[:40]!r}")

    def has(self, key: str) -> bool:
        """True if the key exists with a value other than null."""
        self._read.add(key)
        return self._data.get(key) is not None

    def raw(self, key: str) -> Any:
        self._read.add(key)
        if key not in self._data:
            raise Malformed(f"{self.place} has no {key!r}")
        return self._data[key]

    def _place(self, key: str) -> str:
        return f"{self.place}.{key}"

    def text(self, key: str) -> str:
        return as_text(self.raw(key), self._place(key))

    def integer(self, key: str) -> int:
        return as_integer(self.raw(key), self._place(key))

    def number(self, key: str) -> float:
        return as_number(self.raw(key), self._place(key))

    def truth(self, key: str) -> bool:
        value = self.raw(key)
        if not isinstance(value, bool):
            raise Malformed(f"{self._place(key)} is neither true nor false")
        return value

    def items(self, key: str, read: Callable[[Any, str], Read]) -> tuple[Read, ...]:
        """The list under the key; `read(item, place)` reads each item."""
        place = self._place(key)
        return tuple(
            read(item, f"{place}[{index}]")
            for index, item in enumerate(as_list(self.raw(key), place))
        )


def as_list(value: Any, place: str) -> list[Any]:
    if not isinstance(value, list):
        raise Malformed(f"{place} is no list")
    return cast("list[Any]", value)


def as_text(value: Any, place: str) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST_STRING:
        raise Malformed(f"{place} is no text")
    return value


def as_integer(value: Any, place: str) -> int:
    # in Python a bool is an `int`
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > _LARGEST_INTEGER:
        raise Malformed(f"{place} is no whole number")
    return value


def as_number(value: Any, place: str) -> float:
    if isinstance(value, int):
        return float(as_integer(value, place))
    if not isinstance(value, float) or not math.isfinite(value):
        raise Malformed(f"{place} is no finite number")
    return value


def as_pair(value: Any, place: str) -> tuple[Any, Any]:
    pair = as_list(value, place)
    if len(pair) != 2:
        raise Malformed(f"{place} is no pair")
    return pair[0], pair[1]
