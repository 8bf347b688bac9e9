"""Merges equal values (common subexpression elimination)."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.ops import Named, Reshape
from compiler.ir.program import Graph, NodeId, Program


def share_common(program: Program) -> Program:
    """Merges nodes of equal operation, operands and type; the place and label of the first one
    stay.

    Consecutive reshapes become one, or none if the type does not change. A `Named` node becomes its
    operand. Before: any form. After: any form without `Named`.

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
        args = tuple(copies[arg] for arg in node.args)
        if isinstance(node.op, Reshape):
            args = (_before_reshapes(builder, args[0]),)
        unchanged = isinstance(node.op, Reshape) and builder.type(args[0]) == node.type
        if unchanged or isinstance(node.op, Named):
            copies[index] = args[0]
            # the name may have a declared unit, which its operand lacks
            builder.set_unit(args[0], node.type.unit)
            if node.label is not None:
                builder.name(args[0], node.label)
        else:
            copies[index] = copy_node(builder, node, args)
    return builder.graph(), copies


def _before_reshapes(builder: GraphBuilder, value: NodeId) -> NodeId:
    while isinstance(builder.node(value).op, Reshape):
        value = builder.node(value).args[0]
    return value
