"""Defines the core operations: the closed set that every backend must lower.

Base classes group them, so that a `match` can handle a group in one case (`case ops.Structure():`).
The groups are `Leaf` (with `Read` and `ReadSamples`), `Elementwise` (with `Identity`), `Structure`
and `Reduction`; `Window` belongs to none. The union `Op` lists only the operations themselves, so
that pyright names the operations that a `match` forgets.
"""

from __future__ import annotations

import operator
from enum import Enum
from typing import ClassVar

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class StateAdjoint:
    """∂S/∂(the next value of a state), S the weighted sum of the losses; for a buffer, ∂S/∂(its
    newest sample).
    """

    state: str


@dataclass(frozen=True, slots=True)
class NewestSample:
    """The sample that the forward step appended to a buffer."""

    buffer: str


@dataclass(frozen=True, slots=True)
class KeptRow:
    """The value of node `node` of the forward step at this time, stored by the forward loop."""

    node: int


@dataclass(frozen=True, slots=True)
class LossScale:
    """∂S/∂(the sum of a loss over the elements of this step), S the weighted sum of the losses."""

    loss: str


TrainingValue = StateAdjoint | NewestSample | KeptRow | LossScale


class Relation(Enum):
    """The relation that `Compare` tests between its two operands."""

    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="

    def holds(self, left: float, right: float) -> bool:
        """True if `left relation right`; False if an operand is NaN."""
        return _TESTS[self.value](left, right)


_TESTS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}

# ---- leaves: values that come from outside the graph


@dataclass(frozen=True, slots=True)
class Leaf:
    """A value without operands."""

    arity: ClassVar[int | None] = 0
    """Number of operands; None if it varies."""


@dataclass(frozen=True, slots=True)
class Constant(Leaf):
    """Numbers known at compile time, in C order of the node's axes."""

    values: tuple[float, ...]
    name: str = ""
    """The name of the constant in the spec, for generated code. Equal values of two names are
    two nodes."""


@dataclass(frozen=True, slots=True)
class Read(Leaf):
    """A value that something outside the graph gives."""


@dataclass(frozen=True, slots=True)
class ReadParameter(Read):
    """The physical value of a parameter, constant over a run."""

    name: str


@dataclass(frozen=True, slots=True)
class ReadSamples(Read):
    """Samples t+first … t+last of a signal.

    Without a window axis in the node's type `first == last` and the value is that one sample.
    """

    signal: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class ReadSignal(ReadSamples):
    """Samples t+first … t+last of an input. They come from the log, or in a deployed step from its
    ports.
    """


@dataclass(frozen=True, slots=True)
class ReadLog(ReadSamples):
    """Samples t+first … t+last as recorded, even if a closed loop simulates the signal.

    Only losses and the start read the log.
    """


@dataclass(frozen=True, slots=True)
class ReadState(Read):
    """The current value of a state."""

    name: str


@dataclass(frozen=True, slots=True)
class ReadTraining(Read):
    """A value that training passes to graphs of derivatives; a program has no such node."""

    value: TrainingValue


# ---- elementwise


@dataclass(frozen=True, slots=True)
class Elementwise:
    """Computes each element from the elements at the same position of its operands.

    All operands have the node's axes; `Broadcast` nodes repeat those that lack one.
    """

    arity: ClassVar[int | None] = 2


@dataclass(frozen=True, slots=True)
class Add(Elementwise):
    """a + b."""


@dataclass(frozen=True, slots=True)
class Subtract(Elementwise):
    """a − b."""


@dataclass(frozen=True, slots=True)
class Multiply(Elementwise):
    """a · b."""


@dataclass(frozen=True, slots=True)
class Divide(Elementwise):
    """a / b, IEEE 754: x/0 is ±inf, 0/0 is NaN."""


@dataclass(frozen=True, slots=True)
class Negate(Elementwise):
    """−a."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Minimum(Elementwise):
    """The smaller operand; NaN if one is NaN; the slope of a tie goes to the first."""


@dataclass(frozen=True, slots=True)
class Maximum(Elementwise):
    """The larger operand; NaN if one is NaN; the slope of a tie goes to the first."""


@dataclass(frozen=True, slots=True)
class Clamp(Elementwise):
    """min(max(x, low), high) of operands x, low, high; slope 1 in x on the bounds."""

    arity: ClassVar[int | None] = 3


@dataclass(frozen=True, slots=True)
class Compare(Elementwise):
    """a relation b, a bool; false where an operand is NaN."""

    relation: Relation


@dataclass(frozen=True, slots=True)
class Select(Elementwise):
    """The second operand where the first (a bool) holds, else the third."""

    arity: ClassVar[int | None] = 3


@dataclass(frozen=True, slots=True)
class Apply(Elementwise):
    """A scalar function of the table in `scalars.py`, on every element."""

    function: str

    arity: ClassVar[int | None] = None


@dataclass(frozen=True, slots=True)
class Identity(Elementwise):
    """The operand itself, marked for a pass that looks for it."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Dropout(Identity):
    """The operand; a stage of training leaves elements out at random (`draw_dropout`)."""

    rate: float
    """The probability that an element is dropped, in [0, 1)."""
    layer: str
    """The layer that it belongs to; empty for the function `dropout` of the language."""


@dataclass(frozen=True, slots=True)
class Named(Identity):
    """The operand under the name of an equation or output: a value of its own for gradients."""

    name: str


# ---- structure


@dataclass(frozen=True, slots=True)
class Structure:
    """The operands' numbers, unchanged, at other places."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Broadcast(Structure):
    """The operand repeated along the axes it lacks, in the order of the node's axes (by name)."""


@dataclass(frozen=True, slots=True)
class Reshape(Structure):
    """The operand's numbers in the same order under other axes of the same total size."""


@dataclass(frozen=True, slots=True)
class Slice(Structure):
    """Elements start … stop−1 along one axis."""

    axis: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Concat(Structure):
    """The operands one after the other along one axis; the other axes are equal."""

    axis: str

    arity: ClassVar[int | None] = None


# ---- reductions


@dataclass(frozen=True, slots=True)
class Reduction:
    """A sum over one axis, which disappears.

    It adds from the first element (the oldest sample of a window) to the last, one after the other,
    in every backend that promises bits.
    """

    axis: str

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Sum(Reduction):
    """Σ over one axis, which disappears: ((e₀ + e₁) + e₂) + …."""


@dataclass(frozen=True, slots=True)
class Contract(Reduction):
    """Σ over one axis that both operands have of their product: ((a₀b₀ + a₁b₁) + a₂b₂) + ….

    The node's axes are those of both operands without the contracted one; axes that both have are
    aligned by name, an axis that one lacks is repeated.
    """

    arity: ClassVar[int | None] = 2


# ---- memory


@dataclass(frozen=True, slots=True)
class Window:
    """The samples that a buffer state keeps followed by the newest one, the operand.

    The buffer has length n along the window axis, the result n+1, oldest first. The buffer's next
    value is the result without its first sample, so C keeps it in place.
    """

    state: str

    arity: ClassVar[int | None] = 1


AnyRead = ReadParameter | ReadSignal | ReadLog | ReadState | ReadTraining
"""The operations that read a value from outside the graph."""

_Arithmetic = Add | Subtract | Multiply | Divide | Negate
Computed = _Arithmetic | Minimum | Maximum | Clamp | Compare | Select | Apply
"""The elementwise operations that compute; `Dropout` and `Named` only pass their operand on."""

_Moved = Broadcast | Reshape | Slice | Concat
Op = Constant | AnyRead | Computed | Dropout | Named | _Moved | Sum | Contract | Window
