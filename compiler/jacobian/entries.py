"""Assembles matrices from gradients of single elements."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Constant, ReadParameter, ReadSignal, ReadState
from compiler.ir.program import Graph, NodeId
from compiler.jacobian.drop_zero_terms import known_number
from compiler.jacobian.matrices import Matrix, MatrixBlock, Vector
from compiler.jacobian.row_gradients import Slopes
from compiler.jacobian.scalarize import Leaf, LeafSlice


def matrix_of(
    name: str,
    rows: Vector,
    columns: Vector,
    slopes: Slopes,
    parts: dict[NodeId, LeafSlice],
    builder: GraphBuilder,
) -> Matrix:
    """The matrix whose row i consists of the gradients i, each in the columns of its part.

    Sums for overlapping parts of a leaf are added to the builder.
    """
    entries = _Entries(builder, rows, columns, parts)
    for row, by_part in enumerate(slopes):
        entries.add_row(row, by_part)
    moving = moving_nodes(builder.graph())
    # an entry that depends on no state or input is constant over all steps
    fixed = [True] * len(entries.known)
    for block in entries.blocks:
        for place in block.places(builder.type(block.node).shape).ravel().tolist():
            fixed[place] = not moving[block.node]
    known = tuple(entries.known)
    return Matrix(
        name=name,
        rows=rows,
        columns=columns,
        known=known,
        fixed=tuple(fixed),
        blocks=tuple(entries.blocks),
    )


def moving_nodes(graph: Graph) -> list[bool]:
    """For every node, True if it depends on states or inputs."""
    found: list[bool] = []
    for _, node in graph:
        reads = isinstance(node.op, ReadState | ReadSignal)
        found.append(reads or any(found[arg] for arg in node.args))
    return found


class _Entries:
    def __init__(
        self, builder: GraphBuilder, rows: Vector, columns: Vector, parts: dict[NodeId, LeafSlice]
    ) -> None:
        self._builder = builder
        self._width = columns.size
        self._columns: dict[NodeId, list[int]] = {}
        for node, part in parts.items():
            name = _name_in(columns, part.leaf)
            if name is not None:
                first = columns.member(name).first
                self._columns[node] = [first + number for number in part.numbers]
        self._strides = {node: part.strides for node, part in parts.items()}
        self.known: list[float | None] = [0.0] * (rows.size * columns.size)
        self.blocks: list[MatrixBlock] = []

    def add_row(self, row: int, slopes: dict[NodeId, NodeId]) -> None:
        shared: dict[int, list[tuple[NodeId, int]]] = {}
        for part, slope in slopes.items():
            if part in self._columns:
                places = [row * self._width + column for column in self._columns[part]]
                for number, place in enumerate(places):
                    # parts of a leaf may overlap, such as a vector and one of its elements:
                    # their derivatives are added
                    shared.setdefault(place, []).append((slope, number))
                self._store(slope, places, self._strides[part])
        for place, terms in shared.items():
            if len(terms) > 1:
                numbers = [self._element(slope, number) for slope, number in terms]
                self._store(reduce(self._builder.add, numbers), [place], ())

    def _element(self, value: NodeId, number: int) -> NodeId:
        """One element of a value; `number` counts in C order."""
        b = self._builder
        for axis in reversed(b.type(value).axes):
            number, index = divmod(number, axis.size)
            value = b.element(value, axis.name, index)
        return value

    def _store(self, slope: NodeId, places: Sequence[int], strides: tuple[int, ...]) -> None:
        op = self._builder.node(slope).op
        number = known_number(self._builder, slope)
        # structurally zero or constant entries are stored as constants of the matrix
        known = op.values if isinstance(op, Constant) else [number] * len(places)
        for place, value in zip(places, known, strict=True):
            self.known[place] = value
        if None in known:
            infinite = self._builder.infinite_values.is_made_of_infinite(slope)
            self.blocks.append(MatrixBlock(slope, places[0], strides, infinite))


def _name_in(vector: Vector, leaf: Leaf) -> str | None:
    """The member of the vector that a leaf reads, or None."""
    match vector.letter, leaf:
        case ("x", ReadState(name)) | ("u", ReadSignal(name)) | ("p", ReadParameter(name)):
            return name if any(member.name == name for member in vector.members) else None
        case _:
            return None
