"""Defines integer programs: each value has proved bounds and means integer · 2^−fraction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

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
    """A constant known at compile time."""

    value: int


@dataclass(frozen=True, slots=True)
class ReadWord:
    """An element of an input or, in the start, of a window, in C order."""

    port: str
    index: int


@dataclass(frozen=True, slots=True)
class ReadMemory:
    """An element of a memory at the beginning of the step."""

    memory: str
    index: int


@dataclass(frozen=True, slots=True)
class WeightedSum:
    """constant + Σ coefficientᵢ · operandᵢ, added in this order."""

    constant: int
    coefficients: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Product:
    """a · b, of two operands that are words."""


@dataclass(frozen=True, slots=True)
class RoundShift:
    """⌊a / 2^bits + 1/2⌋: rounds to the nearest integer, halves upwards."""

    bits: int


@dataclass(frozen=True, slots=True)
class Smaller:
    """min(a, b), of operands with the same scale."""


@dataclass(frozen=True, slots=True)
class Larger:
    """max(a, b), of operands with the same scale."""


@dataclass(frozen=True, slots=True)
class Choose:
    """c if `a relation b` holds, else d; the operands are a, b, c, d."""

    relation: Relation


@dataclass(frozen=True, slots=True)
class IntegerLookup:
    """Linear interpolation in a table of a function: `values` are those at the ends of cells, which
    are 2^bits wide and start at `first`.
    """

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
    """An operation on earlier nodes. Its integer is always in low … high and means integer ·
    2^−fraction.
    """

    op: IntegerOp
    args: tuple[int, ...]
    fraction: int
    low: int
    high: int
    span: Span | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class WordPort:
    """The words of an input, an output or a window, in C order of the axes. A word is in low … high
    and means word · 2^−fraction, in `unit`.
    """

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
    """Words stored between steps; a `wide` memory has the bits of a sum."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    fraction: int
    low: int
    high: int
    wide: bool
    next: tuple[int, ...]
    """Nodes of the step with the next values, one per element."""
    start: tuple[int, ...]
    """Nodes of the start with the first values, one per element."""
    from_record: bool
    """True if only `reset` can compute the first values, from recorded samples."""
    first_fills: tuple[str, tuple[int, ...]] | None
    """For a buffer of an input: the port and, for each row, the element with which the first step
    fills it."""
    doc: str
    span: Span | None = field(default=None, compare=False)
    restarts: bool = False
    """True if the memory returns to its start when it leaves its range; otherwise it saturates."""

    @property
    def size(self) -> int:
        return len(self.next)


@dataclass(frozen=True, slots=True)
class CheckedInput:
    """An input of the step, and the policy for words outside its range."""

    port: WordPort
    policy: str


@dataclass(frozen=True, slots=True)
class ExpectedWords:
    """The check of an equation's range: the nodes that may leave it, and their lower and upper
    limits, one per node.
    """

    name: str
    nodes: tuple[int, ...]
    low: tuple[int, ...]
    high: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class StepError:
    """The maximum error that one step adds to an output or a state (decision 0193).

    It compares with a step in real numbers from the same inputs and states; inf if nothing is
    proved.
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
    """The samples around the first step that `reset` reads, oldest first."""
    window_firsts: tuple[int, ...]
    """The time of the oldest sample of each window, in steps relative to the first step."""
    outputs: tuple[tuple[WordPort, tuple[int, ...]], ...]
    memories: tuple[IntegerMemory, ...]
    step: tuple[IntegerNode, ...]
    start: tuple[IntegerNode, ...]
    expected: tuple[ExpectedWords, ...] = ()
    step_errors: tuple[StepError, ...] = ()
    start_errors: tuple[StepError, ...] = ()
    """Maximum errors of the first states, from the same recorded words."""
    doc: str = ""
    spec_hash: str = ""
    made_by: str = ""
    sample_time: float | None = None
    late: int = 0
    """Number of samples by which outputs lag behind the inputs of their step."""

    @property
    def first_samples(self) -> dict[str, int]:
        """The oldest sample of each window by name, in steps relative to the first step."""
        ports = zip(self.windows, self.window_firsts, strict=True)
        return {port.name: first for port, first in ports}


def without_unused(program: IntegerProgram) -> IntegerProgram:
    """The program with only the nodes on which outputs and memories depend."""
    roots = [n for _, nodes in program.outputs for n in nodes]
    roots += [n for memory in program.memories for n in memory.next]
    step, places = reached(program.step, roots)
    # what is checked is also used, within its range
    expected = tuple(
        replace(entry, nodes=tuple(places[node] for node in entry.nodes))
        for entry in program.expected
        if entry.nodes and all(node in places for node in entry.nodes)
    )
    start, firsts = reached(program.start, [n for m in program.memories for n in m.start])
    return replace(
        program,
        step=step,
        start=start,
        expected=expected,
        outputs=tuple(
            (port, tuple(places[node] for node in nodes)) for port, nodes in program.outputs
        ),
        memories=tuple(
            replace(
                memory,
                next=tuple(places[node] for node in memory.next),
                start=tuple(firsts[node] for node in memory.start),
            )
            for memory in program.memories
        ),
    )


def reached(
    nodes: tuple[IntegerNode, ...], roots: Iterable[int]
) -> tuple[tuple[IntegerNode, ...], dict[int, int]]:
    """The nodes on which the `roots` depend, including these, and the new index of each of them by
    its old one.
    """
    wanted = set(roots)
    # operands stand before their users: one pass from the end finds all that is needed
    for index in range(len(nodes) - 1, -1, -1):
        if index in wanted:
            wanted.update(nodes[index].args)
    places = {old: new for new, old in enumerate(sorted(wanted))}
    kept = [nodes[old] for old in sorted(wanted)]
    return tuple(replace(n, args=tuple(places[a] for a in n.args)) for n in kept), places
