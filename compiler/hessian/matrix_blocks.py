"""Assembles matrices from arrays of derivatives, and finds entries that are known constants."""

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
    """The rows of a result in a matrix with `width` columns, from its tangents (directions,
    *axes).
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
    """Places a block (directions, other directions) of a Hessian, and its transpose if
    off-diagonal.
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
    """The matrix with these entries; all others are 0."""
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
    """Splits a concatenation into its parts, so that constant parts need no array."""
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
