"""The core operations: the closed set that every backend lowers, each with its numpy meaning.

Elementwise operations take operands of exactly the same axes; `Broadcast` brings them there. A
reduction adds from the first element of the axis (the oldest sample of a window) to the last, one
after the other, in every backend that promises bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Relation(Enum):
    """How `Compare` relates its two operands."""

    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="


# ---- leaves: values that come from outside the graph


@dataclass(frozen=True, slots=True)
class Constant:
    """Numbers known at compile time, in C order of the node's axes."""

    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ReadParameter:
    """The physical value of a parameter, constant over a run."""

    name: str


@dataclass(frozen=True, slots=True)
class ReadSignal:
    """Samples t+first … t+last of an input as the step sees it: from the log while it is open.

    Without a window axis in the node's type `first == last` and the value is that one sample.
    """

    signal: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class ReadLog:
    """Samples t+first … t+last of the record, whatever the step sees; losses and starts only."""

    signal: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class ReadState:
    """The current value of a state."""

    name: str


# ---- elementwise: operands have the node's axes


@dataclass(frozen=True, slots=True)
class Add:
    """a + b."""


@dataclass(frozen=True, slots=True)
class Subtract:
    """a − b."""


@dataclass(frozen=True, slots=True)
class Multiply:
    """a · b."""


@dataclass(frozen=True, slots=True)
class Divide:
    """a / b, IEEE 754: x/0 is ±inf, 0/0 is NaN."""


@dataclass(frozen=True, slots=True)
class Negate:
    """−a."""


@dataclass(frozen=True, slots=True)
class Minimum:
    """The smaller operand; NaN if one is NaN; the slope of a tie goes to the first."""


@dataclass(frozen=True, slots=True)
class Maximum:
    """The larger operand; NaN if one is NaN; the slope of a tie goes to the first."""


@dataclass(frozen=True, slots=True)
class Clamp:
    """min(max(x, low), high) of operands x, low, high; slope 1 in x on the bounds."""


@dataclass(frozen=True, slots=True)
class Compare:
    """a relation b, a bool; false where an operand is NaN."""

    relation: Relation


@dataclass(frozen=True, slots=True)
class Select:
    """The second operand where the first (a bool) holds, else the third."""


@dataclass(frozen=True, slots=True)
class Apply:
    """A scalar function of the table in `scalars/table.py`, on every element."""

    function: str


@dataclass(frozen=True, slots=True)
class Dropout:
    """The operand; a stage of training leaves elements out at random (`draw_dropout`)."""

    rate: float
    """The share of elements that is left out, 0 … 1 without 1."""
    layer: str
    """The layer that it belongs to, empty for the builtin."""


# ---- structure: same numbers in other axes, or sums along one axis


@dataclass(frozen=True, slots=True)
class Broadcast:
    """The operand repeated along the axes it lacks, in the order of the node's axes (by name)."""


@dataclass(frozen=True, slots=True)
class Reshape:
    """The operand's numbers in the same order under other axes of the same total size."""


@dataclass(frozen=True, slots=True)
class Slice:
    """Elements start … stop−1 along one axis."""

    axis: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Concat:
    """The operands one after the other along one axis; the other axes are equal."""

    axis: str


@dataclass(frozen=True, slots=True)
class Sum:
    """Σ over one axis, which disappears: ((e₀ + e₁) + e₂) + …."""

    axis: str


@dataclass(frozen=True, slots=True)
class Contract:
    """Σ over one axis that both operands have of their product: ((a₀b₀ + a₁b₁) + a₂b₂) + ….

    The node's axes are those of both operands without the contracted one; axes that both have are
    aligned by name, an axis that one lacks is repeated.
    """

    axis: str


# ---- memory


@dataclass(frozen=True, slots=True)
class Window:
    """The samples that a buffer state keeps followed by the newest one, the operand.

    The buffer has length n along the window axis, the result n+1, oldest first. The buffer's next
    value is the result without its first sample, so C keeps it in place.
    """

    state: str


Op = (
    Constant
    | ReadParameter
    | ReadSignal
    | ReadLog
    | ReadState
    | Add
    | Subtract
    | Multiply
    | Divide
    | Negate
    | Minimum
    | Maximum
    | Clamp
    | Compare
    | Select
    | Apply
    | Dropout
    | Broadcast
    | Reshape
    | Slice
    | Concat
    | Sum
    | Contract
    | Window
)
