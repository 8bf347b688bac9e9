"""Represents a spec file as a tree of nodes with places, and interprets unquoted scalars."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True)
class Positions:
    """The place in the file of each character of a scalar's value.

    `offsets` has one file offset for each character and one more for the end.
    """

    source: SourceText
    offsets: Sequence[int]

    def span(self, first: int, last: int) -> Span:
        """The span of `value[first:last]`."""
        # a parser may point behind the text, at what is missing there
        end = len(self.offsets) - 1
        return self.source.span(self.offsets[min(first, end)], self.offsets[min(last, end)])

    def part(self, first: int, last: int) -> "Positions":
        """The positions of the part `value[first:last]`, for a scalar made of it."""
        return Positions(self.source, self.offsets[first : last + 1])


@dataclass(frozen=True, kw_only=True)
class Scalar:
    """A single value of the file: its text, and the value that YAML 1.2 gives to an
    unquoted text.
    """

    text: str
    value: bool | int | float | str | None
    quoted: bool
    # one place a character: escapes and folded lines make text and file differ in length
    positions: Positions
    span: Span
    key: Span | None = None

    @property
    def is_empty(self) -> bool:
        """True if the value is null or nothing is written."""
        return self.value is None

    def part(self, first: int, last: int) -> "Scalar":
        """The text `text[first:last]` as a scalar of its own, always read as a string."""
        text = self.text[first:last]
        positions = self.positions.part(first, last)
        return Scalar(
            text=text,
            value=text,
            quoted=True,
            positions=positions,
            span=positions.span(0, len(text)),
            key=self.key,
        )


@dataclass(frozen=True)
class Listing:
    """A list of the file: its items as nodes, with its place."""

    items: tuple["Node", ...]
    span: Span
    key: Span | None = None


@dataclass(frozen=True)
class Table:
    """A mapping; `keys` holds the place of each key. Keys are NFKC-normalised text."""

    entries: Mapping[str, "Node"]
    keys: Mapping[str, Span]
    span: Span
    key: Span | None = None


Node: TypeAlias = Scalar | Listing | Table


def with_key(node: Node, key: Span) -> Node:
    """The node as the value of a key; an aliased node has a different key at each use."""
    # a copy: the node itself is shared by all aliases of it
    return replace(node, key=key)


def kind(node: Node) -> str:
    """The word for a kind of node in messages, such as "a list"."""
    match node:
        case Listing():
            return "a list"
        case Table():
            return "a mapping"
        case Scalar(value=None):
            return "empty"
        # before numbers: True is an int in Python
        case Scalar(value=bool()):
            return "true or false"
        case Scalar(value=int() | float()):
            return "a number"
        case Scalar():
            return "text"


_NULL = re.compile(r"null|Null|NULL|~|")
_TRUE = re.compile(r"true|True|TRUE")
_FALSE = re.compile(r"false|False|FALSE")
_DECIMAL = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NAN = re.compile(r"\.(nan|NaN|NAN)")
# Python refuses to convert very long digit strings; no number of a spec is near this.
_LONGEST_INTEGER = 100


def core_value(text: str) -> bool | int | float | str | None:
    """The value that YAML 1.2 (core schema) gives to an unquoted text: null, boolean, number or
    text.
    """
    if _NULL.fullmatch(text):
        return None
    if _TRUE.fullmatch(text):
        return True
    if _FALSE.fullmatch(text):
        return False
    # longer ones are read as floats below
    if len(text) <= _LONGEST_INTEGER:
        for pattern, base in ((_DECIMAL, 10), (_OCTAL, 8), (_HEXADECIMAL, 16)):
            if pattern.fullmatch(text):
                return int(text.removeprefix("0o").removeprefix("0x"), base)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITY.fullmatch(text):
        # `-.inf` as Python writes it: `-inf`
        return float(text.replace(".", "", 1))
    return float("nan") if _NAN.fullmatch(text) else text
