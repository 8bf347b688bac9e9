"""Defines programs of integers: every value has proved bounds and means integer · 2^−fraction."""

from __future__ import annotations

from dataclasses import dataclass, field

from compiler.ir.ops import Relation
from compiler.ir.types import Axis
from spec_schema import registry
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True)
class Width:
    """The bits of data and coefficients (`word`), and of sums and products (`sum`)."""

    name: str
    word: int
    sum: int

    @property
    def largest_word(self) -> int:
        return 2 ** (self.word - 1) - 1

    @property
    def largest_sum(self) -> int:
        return 2 ** (self.sum - 1) - 1


WIDTHS: dict[str, Width] = {
    name: Width(name, each.word_bits, each.sum_bits) for name, each in registry.ARITHMETICS.items()
}
Q15, Q31 = WIDTHS["q15"], WIDTHS["q31"]


@dataclass(frozen=True, slots=True)
class Literal:
    """A number known at compile time."""

    value: int


@dataclass(frozen=True, slots=True)
class ReadWord:
    """Element of an input, or in the start of a window, in C order."""

    port: str
    index: int


@dataclass(frozen=True, slots=True)
class ReadMemory:
    """Element of a memory as it is when the step begins."""

    memory: str
    index: int


@dataclass(frozen=True, slots=True)
class WeightedSum:
    """constant + Σ coefficientᵢ · operandᵢ, added in this order."""

    constant: int
    coefficients: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Product:
    """a · b."""


@dataclass(frozen=True, slots=True)
class RoundShift:
    """⌊a / 2^bits + 1/2⌋."""

    bits: int


@dataclass(frozen=True, slots=True)
class Smaller:
    """min(a, b)."""


@dataclass(frozen=True, slots=True)
class Larger:
    """max(a, b)."""


@dataclass(frozen=True, slots=True)
class Choose:
    """c where a relation b holds, else d."""

    relation: Relation


@dataclass(frozen=True, slots=True)
class IntegerLookup:
    """Linear interpolation in a table whose cells are 2^bits wide and begin at `first`."""

    first: int
    bits: int
    values: tuple[int, ...]
    function: str


IntegerOp = (
    Literal
    | ReadWord
    | ReadMemory
    | WeightedSum
    | Product
    | RoundShift
    | Smaller
    | Larger
    | Choose
    | IntegerLookup
)


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegerNode:
    """An operation on nodes before it; its value is always in low … high."""

    op: IntegerOp
    args: tuple[int, ...]
    fraction: int
    low: int
    high: int
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class WordPort:
    """Words that come in or go out, in C order of the axes."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    fraction: int
    low: int
    high: int
    doc: str
    span: Span | None = field(default=None, compare=False)

    @property
    def size(self) -> int:
        size = 1
        for axis in self.axes:
            size *= axis.size
        return size


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegerMemory:
    """Words that stay between steps or, of a state that is summed up, wide numbers."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    fraction: int
    low: int
    high: int
    wide: bool
    next: tuple[int, ...]
    """Nodes of the step, one an element."""
    start: tuple[int, ...]
    """Nodes of the start, one an element."""
    from_record: bool
    """Whether only `reset` can know the start."""
    first_fills: tuple[str, tuple[int, ...]] | None
    """A buffer of an input: the port and, for each row, the element that the first step fills it
    with."""
    doc: str
    span: Span | None = field(default=None, compare=False)
    restarts: bool = False
    """Whether it goes back to its start, which reads no record, instead of the nearest limit."""

    @property
    def size(self) -> int:
        return len(self.next)


@dataclass(frozen=True, slots=True)
class CheckedInput:
    """An input of the step, and what happens to words outside its range."""

    port: WordPort
    policy: str


@dataclass(frozen=True, slots=True)
class ExpectedWords:
    """A range of an equation that its values may leave: nodes, their lowest and highest value."""

    name: str
    nodes: tuple[int, ...]
    low: tuple[int, ...]
    high: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class StepError:
    """The most that one step adds to the error of an output or of a state (decision 0193).

    From the same words in inputs and states, as real numbers; inf where nothing is proved.
    """

    name: str
    is_state: bool
    largest: float


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegerProgram:
    """The step and the start of a model in integers."""

    name: str
    width: Width
    inputs: tuple[CheckedInput, ...]
    windows: tuple[WordPort, ...]
    """What `reset` takes: samples around the first step, oldest first."""
    window_firsts: tuple[int, ...]
    """The oldest sample of each window, relative to the first step."""
    outputs: tuple[tuple[WordPort, tuple[int, ...]], ...]
    memories: tuple[IntegerMemory, ...]
    step: tuple[IntegerNode, ...]
    start: tuple[IntegerNode, ...]
    expected: tuple[ExpectedWords, ...] = ()
    step_errors: tuple[StepError, ...] = ()
    start_errors: tuple[StepError, ...] = ()
    """Of the first states, from the same words of the record."""
    doc: str = ""
    spec_hash: str = ""
    made_by: str = ""
    sample_time: float | None = None
    late: int = 0
    """Samples by which outputs are older than the inputs of their step."""

    @property
    def first_samples(self) -> dict[str, int]:
        """The oldest sample of each window by its name, relative to the first step."""
        ports = zip(self.windows, self.window_firsts, strict=True)
        return {port.name: first for port, first in ports}
