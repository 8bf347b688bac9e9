"""Types values before anything runs: axes, window, unit, kind, what they predict."""

from __future__ import annotations

import math
from typing import Literal

from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit

WINDOW = "t"
"""Name of the axis that holds the samples of a time window, oldest first; always the last axis."""

UNNAMED = ""
"""Name of the one axis a value may have that no `dims:` entry names (number lists, `concat`)."""

Kind = Literal["real", "bool"]


@dataclass(frozen=True, slots=True)
class Axis:
    """One direction of a value: the name that operands align by, and its length."""

    name: str
    size: int


@dataclass(frozen=True, slots=True)
class Type:
    """Axes in memory order (C order, window last), unit (None = not known) and kind of a value."""

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
        """Length of the time window, None where the value is one sample."""
        return self.axes[-1].size if self.axes and self.axes[-1].name == WINDOW else None

    def axis(self, name: str) -> Axis | None:
        """The axis of that name, None where the value does not have it."""
        return next((axis for axis in self.axes if axis.name == name), None)

    def position(self, name: str) -> int:
        """Index of the axis of that name; ValueError where the value does not have it."""
        return self.axis_names.index(name)

    def with_unit(self, unit: Unit | None) -> Type:
        return Type(self.axes, unit, self.kind)

    def with_axes(self, axes: tuple[Axis, ...]) -> Type:
        return Type(axes, self.unit, self.kind)


@dataclass(frozen=True, slots=True)
class Prediction:
    """The prediction that an output makes: `signal[t+ahead]`."""

    signal: str
    ahead: int


def in_order(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
    """The axes with the window moved to the end, where every type keeps it."""
    return tuple(a for a in axes if a.name != WINDOW) + tuple(a for a in axes if a.name == WINDOW)


def describe_axes(axes: tuple[Axis, ...]) -> str:
    """Axes as messages show them: `[joint=6, t=30]`, `scalar` for none."""
    if not axes:
        return "scalar"
    return "[" + ", ".join(f"{axis.name or '_'}={axis.size}" for axis in axes) + "]"
