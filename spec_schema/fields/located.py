"""Defines values of a spec with their place."""

from abc import ABC, abstractmethod
from dataclasses import field
from typing import Generic, TypeVar

from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass

Value = TypeVar("Value")


@dataclass(frozen=True)
class Located(Generic[Value]):
    """A value with its place, and the place of its key if it has one."""

    value: Value
    # a value is the same wherever it is written: equal specs make equal programs
    span: Span = field(compare=False)
    key: Span | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Choice(Located[Value]):
    """A word of a fixed set such as `saturate`: it is no name, whatever is called so."""


@dataclass(frozen=True)
class KeyAndValueSpan:
    """The places of an entry: its key (or name) and its whole value."""

    key: Span
    value: Span


class Spelled(ABC):
    """A value that says itself how it is written in a spec."""

    @property
    @abstractmethod
    def spelling(self) -> object:
        """A value of a spec, such as a tuple or `Located`, which reads as an equal one."""
