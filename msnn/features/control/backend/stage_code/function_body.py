"""Lowers a graph to the body of one C function whose arguments are arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import Argument, Discard, Function, Name, Real, used_names
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.values import LocalValues
from compiler.ir.ops import AnyRead, Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Formula, Graph, NodeId
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.stage_code.array_places import Place, PlacedMatrix

_UNROLL = 4
"""Maximum number of elements for which loops are unrolled."""
_BLOCK = 8
"""Terms of a long sum per iteration of its loop."""
_SIDE_BY_SIDE = 4
"""Partial sums of a dot product, which a processor adds in parallel.

The check against the reference interpreter allows for any order of summation.
"""
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
    """One C function under construction. It maps the reads of the graph to elements of arrays;
    `places` are those of states and signals by name.
    """

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
        # the arrays reserve their names first: local values must not shadow them
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
        """Returns a lowering that writes the statements that compute these nodes into the body."""
        return GraphLowering(self._graph, list(roots), self, self.scope, self._locals)

    def read(self, op: AnyRead, type: Type) -> ArrayView:
        """Returns the view of the array elements that a read of a state or a signal refers to."""
        match op:
            case ReadState(name):
                place = self._places[name]
            case ReadSignal(name):
                place = self._places[name]
            case _:
                raise AssertionError("a trained problem reads states and signals alone")
        return ArrayView(Name(place.array), type.shape, place.strides, Index(place.first))

    def push(self, op: Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        """Raises AssertionError: derivatives read whole windows and have no buffers to shift."""
        raise AssertionError("derivatives have no windows of buffers")

    def write(
        self,
        matrices: Iterable[PlacedMatrix],
        moved: Mapping[NodeId, NodeId],
        results: Sequence[tuple[NodeId, ArrayView]] = (),
    ) -> None:
        """Writes statements that store `results` and the entries of `matrices` in their arrays.

        `moved` maps nodes of matrix blocks to nodes of this graph; other blocks are skipped.
        `results` are pairs of a node and the view of an array to store it in.
        """
        stored = [
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
        entries = [node for _, blocks in stored for _, node in blocks]
        lowered = self.lowered([*(node for node, _ in results), *entries])
        for node, view in results:
            lowered.store(node, view)
        for placed, blocks in stored:
            self._write_known(placed)
            for block, node in blocks:
                for part, view in placed.parts(block, lowered.value(node)):
                    lowered.store_part(node, part, view)

    def _shape(self, node: NodeId) -> tuple[int, ...]:
        """Returns the shape of the value of a node."""
        return self._graph[node].type.shape

    def _write_known(self, placed: PlacedMatrix) -> None:
        """Writes the constant entries of a matrix into its array, zeros included."""
        first, last = placed.first, placed.last
        if first == last:
            return
        place = ArrayView(Name(placed.array), (last,), (1,))
        # all entries are set to 0 first, even those that are written below: one loop is shorter
        # than one statement for each entry that stays 0
        with self.scope.loop(last - first) as (index, inner):
            inner.assign(place.element([index.plus(Index(first))]), Real(0.0))
        for number, value in placed.known().items():
            self.scope.assign(place.element([Index(number)]), Real(value))

    def finished(
        self, name: str, real: str, read: tuple[str, ...], written: tuple[str, ...], doc: str
    ) -> Function:
        """Returns the static C function `<prefix>_<name>(const real *read…, real *written…)`.

        Its body is the statements written so far; `doc` is its comment.
        """
        statements = self.scope.statements
        constants = self._locals.constants(statements)
        # C compilers warn of unused arguments
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
    """Returns the place of each quantity, by name, in the array that holds the vector."""
    return {
        member.name: Place(array, member.first, c_strides(Type(member.axes).shape))
        for member in vector.members
    }


def part(array: str, type: Type, first: int) -> ArrayView:
    """Returns a view of an array from index `first` on, with the shape of `type`."""
    return ArrayView(Name(array), type.shape, c_strides(type.shape), Index(first))


def _names_of_spec(graph: Graph) -> Iterator[str]:
    """Yields the names that the spec gives to nodes and constants of the graph."""
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, Constant) and node.op.name:
            yield node.op.name
