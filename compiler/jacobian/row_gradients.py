"""Gradients of single elements with respect to parts of leaves, as nodes of a graph."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.differentiation.reverse_mode import gradients
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.liveness import needed
from compiler.ir.program import Graph, NodeId
from compiler.jacobian.drop_zero_terms import known_number, without_zeros
from compiler.jacobian.scalarize import Elements, LeafSlice
from compiler.passes.simplify.fold_constants import folded

Slopes = tuple[dict[NodeId, NodeId], ...]
"""For each element its gradients by part nodes, in the axes of the part; absent where 0."""


def slopes_of_elements(elements: Elements, parts: Sequence[NodeId]) -> tuple[Graph, Slopes]:
    """The gradients of all elements with respect to these parts, and the graph of their nodes.

    Reverse mode, one pass per element. The graph reads the leaves directly and contains no known
    zeros.
    """
    draft = GraphBuilder(elements.graph)
    one = draft.constant(1.0)
    passes = {
        element: gradients(draft, {element: one}, parts)
        # an element that two rows share, such as with `y: x`, is differentiated once
        for element in dict.fromkeys(elements.nodes)
    }
    slopes = [
        {part: s for part, s in zip(parts, passes[element], strict=True) if s is not None}
        for element in elements.nodes
    ]
    wanted = [slope for by_part in slopes for slope in by_part.values()]
    graph, read = _with_leaves(draft.graph(), elements.parts, wanted)
    # folding turns constant derivatives into constants before zeros are removed
    graph, moved = folded(graph)
    builder = GraphBuilder()
    found = without_zeros(graph, [moved[read[slope]] for slope in wanted], builder)
    finished = tuple(
        {
            part: slope
            for part, draft_slope in by_part.items()
            if known_number(builder, slope := found[moved[read[draft_slope]]]) != 0.0
        }
        for by_part in slopes
    )
    return builder.graph(), finished


def _with_leaves(
    graph: Graph, parts: dict[NodeId, LeafSlice], wanted: Sequence[NodeId]
) -> tuple[Graph, dict[NodeId, NodeId]]:
    """Rebuilds the wanted nodes on slices of leaves instead of the part nodes."""
    live = needed(graph, wanted)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        if index in parts:
            copies[index] = parts[index].read(builder)
        elif live[index]:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return builder.graph(), copies
