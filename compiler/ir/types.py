"""The static types of values: named axes, the window, unit and kind; and `Prediction`, the signal
that an output predicts.
"""

from __future__ import annotations

import math
from typing import Literal

from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit

WINDOW = "t"
"""Name of the axis that holds the samples of a time window, oldest first; always the last axis."""

UNNAMED = ""
"""Name of an axis that no `dims:` entry names, such as that of a number list; at most one per
value."""

Kind = Literal["real", "bool"]


@dataclass(frozen=True, slots=True)
class Axis:
    """One dimension of a value: its name, by which the axes of two operands are matched, and its
    length.
    """

    name: str
    size: int


@dataclass(frozen=True, slots=True)
class Type:
    """The static type of a value: its axes (elements in C order, the window last), its unit (None
    if unknown) and its kind (real or bool).
    """

    axes: tuple[Axis, ...] = ()
    unit: Unit | None = None
    kind: Kind = "real"

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of scalars in the value."""
        return math.prod(self.shape)

    @property
    def axis_names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @property
    def window(self) -> int | None:
        """Number of samples along the window axis; None for a value without a window."""
        return self.axes[-1].size if self.axes and self.axes[-1].name == WINDOW else None

    def axis(self, name: str) -> Axis | None:
        """The axis of that name; None if there is none."""
        return next((axis for axis in self.axes if axis.name == name), None)

    def position(self, name: str) -> int:
        """Index of the axis of that name. Raises ValueError if there is none."""
        return self.axis_names.index(name)

    def with_unit(self, unit: Unit | None) -> Type:
        """The same type with another unit; None means an unknown one."""
        return Type(self.axes, unit, self.kind)

    def with_axes(self, axes: tuple[Axis, ...]) -> Type:
        """The same unit and kind with other axes."""
        return Type(axes, self.unit, self.kind)


@dataclass(frozen=True, slots=True)
class Prediction:
    """The sample that an output predicts: sample t+ahead of the signal."""

    signal: str
    ahead: int


def in_order(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
    """The axes with the window moved to the end, where every type has it."""
    return tuple(a for a in axes if a.name != WINDOW) + tuple(a for a in axes if a.name == WINDOW)


def describe_axes(axes: tuple[Axis, ...]) -> str:
    """Axes as messages show them: `[joint=6, t=30]`, `scalar` for none."""
    if not axes:
        return "scalar"
    return "[" + ", ".join(f"{axis.name or '_'}={axis.size}" for axis in axes) + "]"
