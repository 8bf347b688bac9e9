"""Defines what an ASAP2 file says of a number or an array in the memory of generated C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Struct: TypeAlias = Literal["params", "in", "out", "state", "calibration"]
"""A struct of the header, by the middle of its type's name."""

Storage: TypeAlias = Literal["FLOAT32_IEEE", "FLOAT64_IEEE", "SWORD", "SLONG", "A_INT64", "ULONG"]
"""How a number lies in memory, in ASAP2's words."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The quantity of numbers: physical = factor · stored; stored as they are by None."""

    unit: str
    """Empty where the spec gives none."""
    factor: float | None = None


@dataclass(frozen=True, slots=True)
class Knots:
    """The numbers along one axis of a curve or a map, which are part of the code."""

    values: tuple[float, ...]
    unit: str
    of: str | None
    """The input or state that is looked up, by its name in the spec; None for what is computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryObject:
    """A member of a struct: a parameter, or what can be measured."""

    name: str
    """In the spec."""
    member: str
    struct: Struct
    doc: str
    axes: tuple[tuple[str, int], ...]
    """Names and lengths, in C order."""
    scale: Scale
    low: float
    high: float
    """Physical; infinite where the storage alone limits it."""
    storage: Storage
    knots: tuple[Knots, ...] = ()
    """One for each axis of a curve or a map that is longer than 1, else none."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(size for _, size in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class Segment:
    """A range of memory of its own, which a variable of the C fills."""

    type: str
    """Of the variable."""
    section: str
    """As a linker knows it."""
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedModel:
    """The content of an ASAP2 file (A2L) for the C code of one model.

    It describes the parameters, inputs, outputs and states that a calibration tool reads or sets.
    """

    name: str
    prefix: str
    """Begins the names of its types in C, and of all that stands in the file."""
    doc: str
    version: str
    """Of the spec that it was made of."""
    objects: Sequence[MemoryObject] = field(default=())
    segment: Segment | None = None
    """Where parameters lie that have a place of their own."""
    remark: str = ""
    """Said at the head of the file."""
