"""Writes one C function of arrays by lowering a graph: the body, and where its graph reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.scope import LocalNames, Scope
from backends.c_language.tree import Argument, Discard, Function, Name, Real
from backends.c_language.used_names import used_names
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.local_values import LocalValues
from backends.c_lowering.spec_notes import SpecNotes
from compiler.ir.ops import AnyRead, Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Formula, Graph
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix, MatrixBlock, Vector

_UNROLL = 4
_BLOCK = 8
_SIDE_BY_SIDE = 4
"""Partial sums: a processor adds them up at once. The judge allows for any order of a sum."""
_ARRAYS = ("z", "given", "weight", "kept", "results", "slopes", "curvature", "limit")


class FunctionBody:
    """One function while it is written; also where its graph finds its leaves."""

    def __init__(
        self,
        graph: Graph,
        functions: FunctionTable,
        formulas: tuple[Formula, ...],
        places: Mapping[str, tuple[str, int]],
    ) -> None:
        self._graph = graph
        self._places = places
        self._functions = functions
        names = LocalNames(functions.prefix, _names_of_spec(graph))
        for array in _ARRAYS:
            names.reserve(array)
        self.scope = Scope(names)
        notes = SpecNotes(graph, formulas)
        self._locals = LocalValues(
            functions,
            notes,
            _UNROLL,
            parallel_sums=_SIDE_BY_SIDE,
            block=_BLOCK,
            names_constants=True,
        )

    def lowered(self, roots: Iterable[int]) -> GraphLowering:
        """What computes these nodes."""
        return GraphLowering(self._graph, list(roots), self, self.scope, self._locals)

    def read(self, op: AnyRead, type: Type) -> ArrayView:
        """Where a leaf of the graph stands."""
        match op:
            case ReadState(name):
                array, first = self._places[name]
            case ReadSignal(name):
                array, first = self._places[name]
            case _:
                raise AssertionError("a trained problem reads states and signals alone")
        return part(array, type, first)

    def push(self, op: Window, newest: ArrayView, scope: Scope) -> ArrayView | None:
        """Never called: derivatives read whole windows."""
        raise AssertionError("derivatives have no windows of buffers")

    def write_known(self, array: str, wider: WiderMatrix) -> None:
        """Entries that are always the same number."""
        if not wider.rows:
            return
        first, last = min(wider.rows) * wider.width, (max(wider.rows) + 1) * wider.width
        place = ArrayView(Name(array), (last,), (1,))
        with self.scope.loop(last - first) as (index, inner):
            inner.assign(place.element([index.plus(Index(first))]), Real(0.0))
        for number, value in wider.known().items():
            self.scope.assign(place.element([Index(number)]), Real(value))

    def finished(
        self, name: str, real: str, read: tuple[str, ...], written: tuple[str, ...], doc: str
    ) -> Function:
        """`<prefix>_<name>(const real *read…, real *written…)`."""
        statements = self.scope.statements
        constants = self._locals.constants(statements)
        used = used_names(statements)
        unused = [Discard(array) for array in (*read, *written) if array not in used]
        arguments = (
            *(Argument(f"const {real} *", array) for array in read),
            *(Argument(f"{real} *", array) for array in written),
        )
        body = (*unused, *constants, *statements)
        prefix = self._functions.prefix
        return Function(f"{prefix}_{name}", "void", arguments, body, doc, static=True)


@dataclass(frozen=True, slots=True)
class WiderMatrix:
    """A matrix in an array with more rows and longer ones."""

    matrix: Matrix
    rows: Sequence[int]
    """Where its rows are; those of one quantity follow each other."""
    width: int

    def place(self, number: int) -> int:
        """Where the entry of that number stands."""
        row, column = divmod(number, self.matrix.shape[1])
        return self.rows[row] * self.width + column

    def entries(self, array: str, block: MatrixBlock, shape: tuple[int, ...]) -> ArrayView:
        """Where the entries of a block stand."""
        columns = self.matrix.shape[1]
        steps = [divmod(stride, columns) for stride in block.strides]
        strides = tuple(rows * self.width + column for rows, column in steps)
        return ArrayView(Name(array), shape, strides, Index(self.place(block.offset)))

    def known(self) -> dict[int, float]:
        """Numbers other than 0 that are always the same, by their places."""
        return {self.place(i): x for i, x in enumerate(self.matrix.known) if x}


def vector_places(array: str, vector: Vector) -> dict[str, tuple[str, int]]:
    """Where each quantity of a vector begins in its array."""
    return {member.name: (array, member.first) for member in vector.members}


def part(array: str, type: Type, first: int) -> ArrayView:
    """Numbers of that type in an array, from `first` on."""
    return ArrayView(Name(array), type.shape, c_strides(type.shape), Index(first))


def _names_of_spec(graph: Graph) -> Iterator[str]:
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, Constant) and node.op.name:
            yield node.op.name
