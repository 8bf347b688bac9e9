"""Defines the contents of an ASAP2 file about objects in the memory of generated C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Struct: TypeAlias = Literal["params", "in", "out", "state", "calibration"]
"""A struct of the header, by the middle part of its type name."""

Storage: TypeAlias = Literal["FLOAT32_IEEE", "FLOAT64_IEEE", "SWORD", "SLONG", "A_INT64", "ULONG"]
"""The ASAP2 name of the data type of an element."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The scaling of stored values: physical = factor · stored; None stores physical values."""

    unit: str
    """Empty if the spec has no unit."""
    factor: float | None = None


@dataclass(frozen=True, slots=True)
class Knots:
    """The points along one axis of a curve or a map, which are constants in the code."""

    values: tuple[float, ...]
    unit: str
    of: str | None
    """The input or state that is looked up, by its name in the spec; None for a computed value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryObject:
    """A member of a struct: a parameter or a measurement."""

    name: str
    """The name in the spec."""
    member: str
    struct: Struct
    doc: str
    axes: tuple[tuple[str, int], ...]
    """Names and lengths of the axes, in C order."""
    scale: Scale
    low: float
    high: float
    """Physical limit; infinite if only the data type limits it."""
    storage: Storage
    knots: tuple[Knots, ...] = ()
    """For a curve or a map, the points of each axis longer than 1; otherwise empty."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(size for _, size in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class Segment:
    """A separate memory range, which one C variable fills."""

    type: str
    """The C type of the variable."""
    section: str
    """The linker section."""
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedModel:
    """The content of an ASAP2 file (A2L) for the C code of one model.

    It describes the parameters, inputs, outputs and states that a calibration tool reads or sets.
    """

    name: str
    prefix: str
    """Prefix of the C type names and of all names in the file."""
    doc: str
    version: str
    """The version of the spec from which it was generated."""
    objects: Sequence[MemoryObject] = field(default=())
    segment: Segment | None = None
    """The memory segment of the parameters, if they have their own."""
    remark: str = ""
    """A remark for the head of the file."""
