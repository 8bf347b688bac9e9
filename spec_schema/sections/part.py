"""Defines what a kind of parts that a feature brings does while a spec is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.registry import PartLine
from spec_schema.sections.dimensions import Dimension
from spec_schema.units.quantity import Quantity
from spec_schema.yaml_tree.nodes import Node

E = TypeVar("E", bound=Entry)
M = TypeVar("M")


class SpecAround(Protocol):
    """The spec that uses a part, as far as the part may know it."""

    @property
    def dims(self) -> Mapping[str, Dimension]: ...

    @property
    def sample_time(self) -> Quantity | None: ...


@dataclass(frozen=True)
class PartRead(Generic[M]):
    """A part as its file and its entry describe it."""

    model: M
    """The data that its members compute with."""
    spec: Node
    """Its dims and parameters, as the tree of a spec with the places of its file."""


@dataclass(frozen=True, kw_only=True)
class PartKind(Generic[E, M]):
    """A kind of parts: `E` is the class of its entry, `M` that of what is read."""

    largest_file: int
    """In bytes."""
    read: Callable[[E, SourceText, str, SpecAround, Findings], PartRead[M] | None]
    """The part, from its entry, the text of its file, its name and the spec around it; None once
    the mistakes are reported."""
    difference: Callable[[str, str], str | None]
    """The difference of two texts of its file in words, that of a run and that of today; None if
    both describe one part."""
    unreadable: Callable[[str, str, Span], Diagnostic]
    """The report of a file that cannot be read, by its path and the reason."""
    beside_spec: Callable[[Span], Diagnostic]
    """The report of an entry of `use` with another kind of part too."""
    with_weights: Callable[[Span], Diagnostic]
    """The report of `weights` beside it."""


AnyPartKind: TypeAlias = PartKind[Any, Any]


def part_kind(line: PartLine) -> AnyPartKind:
    """The kind of parts of a line of the registry, imported when a spec has one."""
    kind: AnyPartKind = line.kind.value
    return kind
