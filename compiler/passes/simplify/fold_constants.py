"""Evaluates constant nodes at compile time."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, evaluator
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Program

LARGEST_FOLDED = 4096
"""Maximum number of elements of a folded value; larger ones would make the program larger."""


def fold_constants(program: Program) -> Program:
    """Replaces nodes that depend on constants only by their float64 value in the interpreter.

    A `Select` with a constant condition becomes the selected operand. Not folded are values that
    are not finite or too large, bools, and broadcast constants.

    Before and after: any form. Nodes that lose their users are left for `drop_unused`.

        %0: scalar 1 = constant 2.0
        %1: scalar 1 = sqrt(%0)

        %1: scalar 1 = constant 1.4142135623730951
    """
    program = with_step(program, *folded(program.step))
    return with_start(program, *folded(program.start))


def folded(
    graph: Graph, *, exact: int = 0, largest: int = LARGEST_FOLDED
) -> tuple[Graph, dict[NodeId, NodeId]]:
    """The graph with its constants folded, and the new node ids.

    The first `exact` nodes do not change; `largest` limits the number of elements of a folded
    value.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    known: list[Any] = []
    for index, node in graph:
        value = _value(graph, node, known, largest)
        # stored even if the node stays, so that its users can be folded
        known.append(value)
        chosen = _chosen(node, known) if index >= exact else None
        if chosen is not None:
            copies[index] = copies[chosen]
        elif index >= exact and value is not None and _replaces(graph, node, value):
            numbers = ops.Constant(tuple(float(number) for number in value.ravel()))
            folded = Node(op=numbers, args=(), type=node.type, span=node.span, label=node.label)
            copies[index] = copy_node(builder, folded, ())
        else:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return builder.graph(), copies


def _value(graph: Graph, node: Node, known: list[Any], largest: int) -> Array | None:
    """The node's value, (1, *shape), if it depends on constants only."""
    if isinstance(node.op, ops.Read | ops.Window) or node.type.size > largest:
        return None
    if any(known[arg] is None for arg in node.args):
        return None
    types = tuple(graph[arg].type for arg in node.args)
    evaluate = evaluator(node, types, {}, np.dtype(np.float64))
    with np.errstate(all="ignore"):
        return evaluate(known, NOWHERE)


def _chosen(node: Node, known: list[Any]) -> NodeId | None:
    """The operand that a `Select` with a constant condition selects."""
    if not isinstance(node.op, ops.Select):
        return None
    condition, then, otherwise = node.args
    holds = known[condition]
    # conditions that differ between elements need the selection
    if holds is None or holds.any() != holds.all():
        return None
    return then if holds.all() else otherwise


def _replaces(graph: Graph, node: Node, value: Array) -> bool:
    if isinstance(node.op, ops.Constant) or node.type.kind != "real":
        return False
    # a broadcast constant is stored once
    if isinstance(node.op, ops.Broadcast) and graph[node.args[0]].type.size < node.type.size:
        return False
    # a value that is not finite stays an operation, for which `never_finite` warns
    return bool(np.isfinite(value).all())
