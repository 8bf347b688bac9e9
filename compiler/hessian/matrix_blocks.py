"""Puts arrays of slopes where they belong in a matrix, and finds which entries are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compiler.hessian.directions import DirectionRun
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.jacobian.drop_zero_terms import known_number
from compiler.jacobian.entries import moving_nodes
from compiler.jacobian.matrices import Matrix, MatrixBlock, Member, Vector
from compiler.jacobian.sparsity_pattern import nonzero_elements


@dataclass(frozen=True, slots=True)
class Placed:
    """Entries of a matrix: element (i, j, …) of the node is entry offset + Σ stride · index."""

    node: NodeId
    offset: int
    strides: tuple[int, ...]


def slopes_of_result(
    builder: GraphBuilder, tangent: NodeId, result: Member, runs: Sequence[DirectionRun], width: int
) -> list[Placed]:
    """The rows of a result in a matrix of that width, from its tangents (directions, *axes)."""
    directions = builder.type(tangent).axes[0].name
    lengths = [axis.size for axis in result.axes]
    # C order of the result's axes: one row of the matrix an element
    steps = tuple(width * int(np.prod(lengths[i + 1 :])) for i in range(len(lengths)))
    return [
        Placed(
            builder.slice(tangent, directions, run.start, run.stop),
            result.first * width + run.column,
            # one column further for each direction of the run, a row further for each element of
            # the result
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
    """Places a block (directions, other directions) of a Hessian; mirrored if not square."""
    first, second = (axis.name for axis in builder.type(block).axes)
    found: list[Placed] = []
    for row in rows:
        part = builder.slice(block, first, row.start, row.stop)
        for column in columns:
            node = builder.slice(part, second, column.start, column.stop)
            found.append(Placed(node, row.column * width + column.column, (width, 1)))
            # a block off the diagonal is there once; its mirror image has the strides exchanged
            if rows is not columns:
                found.append(Placed(node, column.column * width + row.column, (1, width)))
    return found


def matrix_of_blocks(
    builder: GraphBuilder, name: str, rows: Vector, columns: Vector, placed: Sequence[Placed]
) -> Matrix:
    """The matrix with these entries; all others are 0."""
    parts = [part for block in placed for part in _parts(builder, block)]
    # until a block says otherwise an entry is 0, and so depends on nothing
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
        # what is the same whatever is given needs no computed entry: exports write it as a constant
        if isinstance(node.op, ops.Constant) or number is not None:
            values = node.op.values if isinstance(node.op, ops.Constant) else [number] * len(places)
            for place, value in zip(places, values, strict=True):
                known[place] = value
            continue
        # the pattern says which elements can differ from 0 at all; the others are known too
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
    """The parts of a concatenation each at its place, so that known ones need no array."""
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
