"""Matrices of derivatives: the quantities of their rows and columns, and their constant or computed
entries.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Graph, NodeId
from compiler.ir.types import Axis, Type
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True)
class Member:
    """A quantity within a stacked vector; its elements are in C order of its axes."""

    name: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    first: int
    """Index of its first element in the vector."""

    @property
    def size(self) -> int:
        return Type(self.axes).size


@dataclass(frozen=True, slots=True)
class Vector:
    """A vector of quantities one after the other, with its usual letter: x (states), u (inputs), y
    (outputs) or p (parameters).
    """

    letter: str
    members: tuple[Member, ...]

    @property
    def size(self) -> int:
        return sum(member.size for member in self.members)

    def member(self, name: str) -> Member:
        """The quantity of that name. Raises StopIteration if the vector has none."""
        return next(member for member in self.members if member.name == name)


Quantity = tuple[str, tuple[Axis, ...], Unit | None]


def vector_of(letter: str, quantities: Iterable[Quantity]) -> Vector:
    """The vector of these quantities in order; each is a tuple (name, axes, unit). `letter` is its
    usual letter, such as x.
    """
    members: list[Member] = []
    for name, axes, unit in quantities:
        first = members[-1].first + members[-1].size if members else 0
        members.append(Member(name, axes, unit, first))
    return Vector(letter, tuple(members))


def by_name(vector: Vector, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Splits stacked vectors into their quantities: `values` are (rows, size), each result is
    (rows, *shape), by name.
    """
    return {
        m.name: values[:, m.first : m.first + m.size].reshape(-1, *Type(m.axes).shape)
        for m in vector.members
    }


@dataclass(frozen=True, slots=True)
class MatrixBlock:
    """Computed entries of a matrix: element (i, j, …) of the node is the entry with the row-major
    index offset + Σ stride · index.
    """

    node: NodeId
    offset: int
    strides: tuple[int, ...]
    can_be_infinite: bool
    """True if the entry can be infinite for finite states, inputs and parameters."""

    def places(self, shape: tuple[int, ...]) -> NDArray[np.int64]:
        """For each element of the node, which has this shape, the row-major index of its entry in
        the matrix.
        """
        return strided_places(self.offset, shape, self.strides)


def strided_places(offset: int, shape: Sequence[int], strides: Sequence[int]) -> NDArray[np.int64]:
    """An array of this shape with the value offset + Σ stride · index for every element."""
    grid = np.array(offset)
    # adds one axis per iteration until the result has the shape of the array
    for size, stride in zip(shape, strides, strict=True):
        grid = grid[..., np.newaxis] + stride * np.arange(size)
    return grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Matrix:
    """The derivatives of the quantities `rows` by the quantities `columns`. Entry (i, j) has the
    row-major index i · columns + j.
    """

    name: str
    rows: Vector
    columns: Vector
    known: tuple[float | None, ...]
    """Constant entries; None for a computed entry."""
    fixed: tuple[bool, ...]
    """True for entries that depend on parameters only."""
    blocks: tuple[MatrixBlock, ...]
    """In the order of writing: later blocks overwrite entries of earlier ones."""

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows.size, self.columns.size

    @property
    def size(self) -> int:
        return len(self.known)

    @property
    def nodes(self) -> list[NodeId]:
        """The nodes of the computed entries, one per block."""
        return [block.node for block in self.blocks]

    @property
    def perhaps_infinite(self) -> tuple[MatrixBlock, ...]:
        """The blocks with entries that can be infinite although all states, inputs and parameters
        are finite.
        """
        return tuple(block for block in self.blocks if block.can_be_infinite)

    def filled(
        self, values: Mapping[NodeId, NDArray[Any]], members: int, dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        """The matrices of all members, (members, rows, columns), from the `values` (members,
        *shape) of the computed nodes. Constant entries are filled in.
        """
        numbers = [0.0 if number is None else number for number in self.known]
        # entries without a block are equal in all members
        entries = np.tile(np.array(numbers, dtype), (members, 1))
        # in order: a later block overwrites entries of an earlier one
        for block in self.blocks:
            computed = values[block.node]
            entries[:, block.places(computed.shape[1:])] = computed
        return entries.reshape(members, *self.shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class Jacobian:
    """The matrices of a Jacobian, the vectors of their rows and columns, and the graph that
    computes their entries.
    """

    graph: Graph
    matrices: tuple[Matrix, ...]
    states: Vector
    inputs: Vector
    outputs: Vector
    parameters: Vector

    @property
    def roots(self) -> list[NodeId]:
        """The nodes of all computed entries of all matrices."""
        return [node for matrix in self.matrices for node in matrix.nodes]
