"""`local_model`: a layer for each cell of a grid of fuzzy sets, weighted by its activations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from compiler.layers.layer_context import LayerContext
from compiler.program import NodeId
from compiler.types import Axis


def local_model(
    context: LayerContext,
    activations: Sequence[NodeId],
    axes: Sequence[Axis],
    cell: Callable[[LayerContext], NodeId],
) -> NodeId:
    """y = Σᵢⱼ… φᵢ · ψⱼ · … · cellᵢⱼ…(x): one vectorised operation whatever the number of cells.

    `axes` are the axes of the sets, one for each activation; `cell` expands the layer of a cell in
    a context whose weights have these axes too.
    """
    builder = context.builder
    result = cell(context.in_cells((*context.cells, *axes)))
    # Innermost first: each contraction removes one axis of the grid.
    for activation, axis in zip(reversed(activations), reversed(axes), strict=True):
        along = tuple(a for a in builder.type(activation).axes if a.name != axis.name)
        result = builder.contract(builder.broadcast(activation, (*along, axis)), result)
    return result
