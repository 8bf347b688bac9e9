"""Writes one C function of arrays by lowering a graph: the body, and where its graph reads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import Argument, Discard, Function, Name, Real
from backends.c_language.used_names import used_names
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.local_values import LocalValues
from backends.c_lowering.spec_notes import SpecNotes
from compiler.ir.ops import AnyRead, Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Formula, Graph, NodeId
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.stage_code.placed_matrix import PlacedMatrix
from msnn.features.control.backend.stage_code.series import Place

_UNROLL = 4
_BLOCK = 8
_SIDE_BY_SIDE = 4
"""Partial sums: a processor adds them up at once. The judge allows for any order of a sum."""
_ARRAYS = (
    "z",
    "given",
    "weight",
    "kept",
    "results",
    "slopes",
    "curvature",
    "steady",
    "limit",
)


class FunctionBody:
    """One function while it is written; also where its graph finds its leaves."""

    def __init__(
        self,
        graph: Graph,
        functions: FunctionTable,
        formulas: tuple[Formula, ...],
        places: Mapping[str, Place],
    ) -> None:
        self._graph = graph
        self._places = places
        self._functions = functions
        names = LocalNames(functions.prefix, _names_of_spec(graph))
        # arrays of the function have their names before values do
        for array in _ARRAYS:
            names.reserve(array)
        self.scope = BlockScope(names)
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
        """The lowering that computes these nodes."""
        return GraphLowering(self._graph, list(roots), self, self.scope, self._locals)

    def read(self, op: AnyRead, type: Type) -> ArrayView:
        """The place of a leaf of the graph."""
        match op:
            case ReadState(name):
                place = self._places[name]
            case ReadSignal(name):
                place = self._places[name]
            case _:
                raise AssertionError("a trained problem reads states and signals alone")
        return ArrayView(Name(place.array), type.shape, place.strides, Index(place.first))

    def push(self, op: Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        """Never called: derivatives read whole windows."""
        raise AssertionError("derivatives have no windows of buffers")

    def write(
        self,
        matrices: Iterable[PlacedMatrix],
        moved: Mapping[NodeId, NodeId],
        results: Sequence[tuple[NodeId, ArrayView]] = (),
    ) -> None:
        """Results, and the entries that the arrays have; `moved` says which nodes these are."""
        wanted = [
            (
                placed,
                [
                    (block, moved[block.node])
                    for block in placed.matrix.blocks
                    if block.node in moved and placed.has(block, self._shape(moved[block.node]))
                ],
            )
            for placed in matrices
        ]
        entries = [node for _, blocks in wanted for _, node in blocks]
        lowered = self.lowered([*(node for node, _ in results), *entries])
        for node, view in results:
            lowered.store(node, view)
        for placed, blocks in wanted:
            self._write_known(placed)
            for block, node in blocks:
                for part, view in placed.parts(block, lowered.value(node)):
                    lowered.store_part(node, part, view)

    def _shape(self, node: NodeId) -> tuple[int, ...]:
        return self._graph[node].type.shape

    def _write_known(self, placed: PlacedMatrix) -> None:
        """Entries that are always the same number."""
        first, last = placed.first, placed.last
        if first == last:
            return
        place = ArrayView(Name(placed.array), (last,), (1,))
        # all entries become 0 first, also those that are written below: a loop is shorter than a
        # list of those that stay 0
        with self.scope.loop(last - first) as (index, inner):
            inner.assign(place.element([index.plus(Index(first))]), Real(0.0))
        for number, value in placed.known().items():
            self.scope.assign(place.element([Index(number)]), Real(value))

    def finished(
        self, name: str, real: str, read: tuple[str, ...], written: tuple[str, ...], doc: str
    ) -> Function:
        """`<prefix>_<name>(const real *read…, real *written…)`."""
        statements = self.scope.statements
        constants = self._locals.constants(statements)
        # C compilers warn of arguments that nothing reads
        used = used_names(statements)
        unused = [Discard(array) for array in (*read, *written) if array not in used]
        arguments = (
            *(Argument(f"const {real} *", array) for array in read),
            *(Argument(f"{real} *", array) for array in written),
        )
        body = (*unused, *constants, *statements)
        prefix = self._functions.prefix
        return Function(
            name=f"{prefix}_{name}",
            result="void",
            arguments=arguments,
            body=body,
            doc=doc,
            static=True,
        )


def vector_places(array: str, vector: Vector) -> dict[str, Place]:
    """The place where each quantity of a vector begins in its array."""
    return {
        member.name: Place(array, member.first, c_strides(Type(member.axes).shape))
        for member in vector.members
    }


def part(array: str, type: Type, first: int) -> ArrayView:
    """Numbers of that type in an array, from `first` on."""
    return ArrayView(Name(array), type.shape, c_strides(type.shape), Index(first))


def _names_of_spec(graph: Graph) -> Iterator[str]:
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, Constant) and node.op.name:
            yield node.op.name
