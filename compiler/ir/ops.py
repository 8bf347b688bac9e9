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
    """∂S/∂(the next value of the state `state`), with S the weighted sum of the losses; for a
    buffer, ∂S/∂(its newest sample).
    """

    state: str


@dataclass(frozen=True, slots=True)
class NewestSample:
    """The sample that the forward step appended to the buffer of this name."""

    buffer: str


@dataclass(frozen=True, slots=True)
class KeptRow:
    """The value that node `node` of the forward step had at this time; the loop over time of the
    forward steps stored it.
    """

    node: int


@dataclass(frozen=True, slots=True)
class LossScale:
    """∂S/∂(the sum of a loss over the elements of this step), with S the weighted sum of the
    losses; `loss` is the name of the loss.
    """

    loss: str


TrainingValue = StateAdjoint | NewestSample | KeptRow | LossScale


class Relation(Enum):
    """The relation that `Compare` tests between its two operands."""

    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="

    def holds(self, left: float, right: float) -> bool:
        """True if the relation holds between two numbers, such as left < right; False if one is
        NaN.
        """
        return _TESTS[self.value](left, right)


_TESTS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}

# ---- leaves: values that come from outside the graph


@dataclass(frozen=True, slots=True)
class Leaf:
    """An operation without operands: a constant or a read."""

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
    """A value from outside the graph: of a parameter, a signal, a state or the training."""


@dataclass(frozen=True, slots=True)
class ReadParameter(Read):
    """The physical value of the parameter `name`, constant during a rollout."""

    name: str


@dataclass(frozen=True, slots=True)
class ReadSamples(Read):
    """Samples t+first … t+last of a signal, along the window axis of the node's type.

    If the type has no window axis, `first == last` and the value is that one sample.
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
    """The value of the state `name` at t, before the step changes it."""

    name: str


@dataclass(frozen=True, slots=True)
class ReadTraining(Read):
    """A value that a training passes to a graph of derivatives. The graphs of a `Program` have no
    such node.
    """

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
    """a + b of its operands a and b, element by element."""


@dataclass(frozen=True, slots=True)
class Subtract(Elementwise):
    """a − b of its operands a and b, element by element."""


@dataclass(frozen=True, slots=True)
class Multiply(Elementwise):
    """a · b of its operands a and b, element by element."""


@dataclass(frozen=True, slots=True)
class Divide(Elementwise):
    """a / b of its operands a and b, element by element, by IEEE 754: x/0 is ±inf, 0/0 is NaN."""


@dataclass(frozen=True, slots=True)
class Negate(Elementwise):
    """−a of its operand a, element by element."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Minimum(Elementwise):
    """The smaller operand; NaN if one is NaN. If they are equal, the derivative is that of the
    first.
    """


@dataclass(frozen=True, slots=True)
class Maximum(Elementwise):
    """The larger operand; NaN if one is NaN. If they are equal, the derivative is that of the
    first.
    """


@dataclass(frozen=True, slots=True)
class Clamp(Elementwise):
    """min(max(x, low), high) of operands x, low, high. On the limits the derivative by x is 1."""

    arity: ClassVar[int | None] = 3


@dataclass(frozen=True, slots=True)
class Compare(Elementwise):
    """True where `a relation b` holds, such as a < b; False where an operand is NaN."""

    relation: Relation


@dataclass(frozen=True, slots=True)
class Select(Elementwise):
    """Element by element, the second operand where the first (a bool) is true, else the third."""

    arity: ClassVar[int | None] = 3


@dataclass(frozen=True, slots=True)
class Apply(Elementwise):
    """The scalar function `function` of the table in `scalars.py`, applied to each element."""

    function: str

    arity: ClassVar[int | None] = None


@dataclass(frozen=True, slots=True)
class Identity(Elementwise):
    """The operand unchanged; the node only marks it for a pass that looks for such nodes."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Dropout(Identity):
    """The operand unchanged. During training, `draw_dropout` sets elements of it to 0 at random."""

    rate: float
    """The probability that an element is dropped, in [0, 1)."""
    layer: str
    """The layer that it belongs to; empty for the function `dropout` of the language."""


@dataclass(frozen=True, slots=True)
class Named(Identity):
    """The operand unchanged, marked as the value of the equation or output `name`. Gradients can be
    taken with respect to this node.
    """

    name: str


# ---- structure


@dataclass(frozen=True, slots=True)
class Structure:
    """The elements of the operands, unchanged, in another arrangement."""

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Broadcast(Structure):
    """The operand repeated along the axes that it lacks. The node's type lists the axes of the
    result, matched by name.
    """


@dataclass(frozen=True, slots=True)
class Reshape(Structure):
    """The operand's elements in the same order, under other axes of the same total size."""


@dataclass(frozen=True, slots=True)
class Slice(Structure):
    """Elements start … stop−1, counted from 0, along the axis named `axis`, which remains."""

    axis: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Concat(Structure):
    """The operands one after the other along the axis named `axis`; their other axes are equal."""

    axis: str

    arity: ClassVar[int | None] = None


# ---- reductions


@dataclass(frozen=True, slots=True)
class Reduction:
    """A sum over the axis named `axis`, which is removed.

    It adds one element after the other, from the first (the oldest sample of a window) to the last.
    Every backend that guarantees the bits of the reference interpreter keeps this order.
    """

    axis: str

    arity: ClassVar[int | None] = 1


@dataclass(frozen=True, slots=True)
class Sum(Reduction):
    """Sum of the operand's elements e₀, e₁, … over one axis, which is removed: ((e₀ + e₁) + e₂) +
    ….
    """


@dataclass(frozen=True, slots=True)
class Contract(Reduction):
    """Sum of the products of two operands a and b over one axis that both have: ((a₀b₀ + a₁b₁) +
    a₂b₂) + ….

    The node's axes are those of both operands without the contracted one. Axes that both have are
    matched by name; an axis that one lacks is repeated.
    """

    arity: ClassVar[int | None] = 2


# ---- memory


@dataclass(frozen=True, slots=True)
class Window:
    """The samples stored in the buffer `state`, followed by the newest one, the operand.

    The buffer has n samples along the window axis, the result n+1, oldest first. The buffer's next
    value is the result without its first sample, so generated C updates it in place.
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
