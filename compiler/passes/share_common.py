"""Computes equal values once."""

from __future__ import annotations

from compiler.builder import GraphBuilder
from compiler.graph_copy import copy_node, with_start, with_step
from compiler.program import Graph, NodeId, Program


def share_common(program: Program) -> Program:
    """Merges nodes of equal operation, operands and type; the first one's place and name stay.

    Before and after: any form.

        %1: scalar m = %0 * %0
        %2: scalar m = %0 * %0
        %3: scalar m = %1 + %2

        %1: scalar m = %0 * %0
        %2: scalar m = %1 + %1
    """
    program = with_step(program, *_shared(program.step))
    return with_start(program, *_shared(program.start))


def _shared(graph: Graph) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return builder.graph(), copies
