"""Assembles matrices from arrays of derivatives, and finds entries that are constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from compiler.hessian.curvature import DirectionRun
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Axis
from compiler.jacobian.jacobian import moving_nodes
from compiler.jacobian.matrices import Matrix, MatrixBlock, Member, Vector
from compiler.jacobian.zeros import known_number, nonzero_elements


@dataclass(frozen=True, slots=True)
class Placed:
    """A node whose elements are entries of a matrix, and their positions.

    Element (i, j, …) of the node is the entry with the row-major index offset + Σ stride · index.
    """

    node: NodeId
    offset: int
    strides: tuple[int, ...]


def slopes_of_result(
    builder: GraphBuilder, tangent: NodeId, result: Member, runs: Sequence[DirectionRun], width: int
) -> list[Placed]:
    """Places the derivatives of one result in a Jacobian with `width` columns and one row per
    element of the result.

    `tangent` has the axes (directions, *axes of the result); `runs` map its directions to columns.
    """
    directions = builder.type(tangent).axes[0].name
    lengths = [axis.size for axis in result.axes]
    # C order of the result's axes: one matrix row per element
    steps = tuple(width * int(np.prod(lengths[i + 1 :])) for i in range(len(lengths)))
    return [
        Placed(
            builder.slice(tangent, directions, run.start, run.stop),
            result.first * width + run.column,
            # the next direction is one column further, the next element of the result one row
            (1, *steps),
        )
        for run in runs
    ]


def curvature_of_groups(
    builder: GraphBuilder,
    block: NodeId,
    rows: Sequence[DirectionRun],
    columns: Sequence[DirectionRun],
    width: int,
) -> list[Placed]:
    """Places a block (directions, other directions) in a Hessian with `width` columns. `rows` and
    `columns` map the directions to rows and columns. The transpose is placed, too, unless both are
    the same object.
    """
    first, second = (axis.name for axis in builder.type(block).axes)
    found: list[Placed] = []
    for row in rows:
        part = builder.slice(block, first, row.start, row.stop)
        for column in columns:
            node = builder.slice(part, second, column.start, column.stop)
            found.append(Placed(node, row.column * width + column.column, (width, 1)))
            # an off-diagonal block is computed once; its transpose has exchanged strides
            if rows is not columns:
                found.append(Placed(node, column.column * width + row.column, (1, width)))
    return found


def matrix_of_blocks(
    builder: GraphBuilder, name: str, rows: Vector, columns: Vector, placed: Sequence[Placed]
) -> Matrix:
    """The matrix with the entries `placed`; all others are 0. `rows` and `columns` are the
    quantities along its sides. Constant entries become numbers of the matrix.
    """
    parts = [part for block in placed for part in _parts(builder, block)]
    # entries without a block are 0 and constant
    known: list[float | None] = [0.0] * (rows.size * columns.size)
    fixed = [True] * len(known)
    blocks: list[MatrixBlock] = []
    graph = builder.graph()
    moving = moving_nodes(graph)
    pattern = nonzero_elements(graph, [part.node for part in parts])
    for part in parts:
        node = builder.node(part.node)
        block = MatrixBlock(
            part.node,
            part.offset,
            part.strides,
            builder.infinite_values.is_made_of_infinite(part.node),
        )
        places = block.places(node.type.shape).ravel().tolist()
        number = known_number(builder, part.node)
        # a constant entry is not computed: exports write it as a literal
        if isinstance(node.op, ops.Constant) or number is not None:
            values = node.op.values if isinstance(node.op, ops.Constant) else [number] * len(places)
            for place, value in zip(places, values, strict=True):
                known[place] = value
            continue
        # elements outside the sparsity pattern are known to be 0
        for place, differs in zip(places, pattern[part.node].ravel().tolist(), strict=True):
            known[place] = None if differs else 0.0
            fixed[place] = not moving[part.node]
        blocks.append(block)
    return Matrix(
        name=name,
        rows=rows,
        columns=columns,
        known=tuple(known),
        fixed=tuple(fixed),
        blocks=tuple(blocks),
    )


def _parts(builder: GraphBuilder, placed: Placed) -> list[Placed]:
    """If the node of `placed` is a concatenation, its parts, each with its place in the matrix, so
    that constant parts need no array. Any other node unchanged.
    """
    node = builder.node(placed.node)
    if not isinstance(node.op, ops.Concat):
        return [placed]
    position = node.type.position(node.op.axis)
    found: list[Placed] = []
    offset = placed.offset
    for arg in node.args:
        found += _parts(builder, Placed(arg, offset, placed.strides))
        offset += placed.strides[position] * builder.type(arg).shape[position]
    return found


_MOST_RUNS = 8
"""Maximum number of slices; beyond it, the loop of the product is cheaper."""


def with_picked_rows(graph: Graph, *, exact: int = 0) -> tuple[Graph, dict[NodeId, NodeId]]:
    """Replaces products with a selection matrix by slices; returns the graph and the new node ids
    by the old ones.

    Σ over k of C[d, k] · x[k, …], with at most one nonzero element in each row d of the constant C,
    is that element times x[k(d), …]. Such products arise from derivatives in unit directions. The
    first `exact` nodes do not change.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        made: NodeId | None = None
        if index >= exact and isinstance(node.op, ops.Contract):
            with builder.at(node.span):
                made = _picked(builder, node, node.op.axis, args)
        copies[index] = copy_node(builder, node, args) if made is None else made
    return builder.graph(), copies


def _picked(b: GraphBuilder, node: Node, axis: str, args: Sequence[NodeId]) -> NodeId | None:
    for matrix, other in (args, args[::-1]):
        op, axes = b.node(matrix).op, b.type(matrix).axes
        if not isinstance(op, ops.Constant) or len(axes) != 2:
            continue
        (rows,) = (a for a in axes if a.name != axis)
        # an operand with the axis of the rows is aligned elementwise, not multiplied as a vector
        if b.type(other).axis(rows.name) is not None:
            continue
        values = np.reshape(op.values, b.type(matrix).shape)
        values = values if axes[0] is rows else values.T
        runs = _runs(values)
        if runs is not None:
            parts = [_rows(b, node, values[slice(*run)], axis, rows, other) for run in runs]
            return b.concat(parts, rows.name) if len(parts) > 1 else parts[0]
    return None


def _runs(values: NDArray[np.float64]) -> list[tuple[int, int]] | None:
    """Splits the rows of the matrix `values` into runs (start, stop), stop exclusive, of rows that
    select consecutive elements or are 0. None if a row selects several elements or there are too
    many runs.
    """
    nonzero = values != 0
    # two nonzero elements in a row are a sum, not a slice
    if (nonzero.sum(axis=1) > 1).any():
        return None
    # offset of the selected column from its row: constant in a run; None for rows of zeros
    ahead = np.where(nonzero.any(axis=1), nonzero.argmax(axis=1) - np.arange(len(values)), None)
    runs: list[tuple[int, int]] = []
    for _, group in groupby(range(len(values)), key=lambda row: ahead[row]):
        members = list(group)
        runs.append((members[0], members[-1] + 1))
    return runs if len(runs) <= _MOST_RUNS else None


def _rows(
    b: GraphBuilder, node: Node, values: NDArray[np.float64], axis: str, rows: Axis, other: NodeId
) -> NodeId:
    here = Axis(rows.name, len(values))
    axes = tuple(here if a.name == rows.name else a for a in node.type.axes)
    numbers = values.sum(axis=1)
    if not numbers.any():
        return b.broadcast(b.constant(0.0, unit=None), axes)
    first = int(np.flatnonzero(values[0])[0])
    part = b.slice(other, axis, first, first + len(values))
    renamed = tuple(here if a.name == axis else a for a in b.type(part).axes)
    part = b.broadcast(b.reshape(part, renamed), axes)
    if (numbers == 1).all():
        return part
    return b.multiply(part, b.broadcast(b.constant(numbers, (here,), unit=None), axes))
