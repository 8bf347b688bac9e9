"""Computes at compile time what depends on numbers of the spec only."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, evaluator
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Program

LARGEST_FOLDED = 4096
"""Elements of the largest value that is computed; beyond it the program stays smaller as it is."""


def fold_constants(program: Program) -> Program:
    """Replaces nodes that depend on constants only by their float64 value in the interpreter.

    A `Select` whose condition is known becomes the operand that it chooses. Kept as they are:
    values that are not finite or too large, bools, and a constant that is only repeated.

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
    """One graph with its constants folded, and where each node is in it now.

    The first `exact` nodes stay as they are; `largest` is the elements of a value that is computed.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    known: list[Any] = []
    for index, node in graph:
        value = _value(graph, node, known, largest)
        # known also where the node stays, so that what is made of it can be folded
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
    """The node's value, (1, *shape), where it depends on constants only."""
    if isinstance(node.op, ops.Read | ops.Window) or node.type.size > largest:
        return None
    if any(known[arg] is None for arg in node.args):
        return None
    types = tuple(graph[arg].type for arg in node.args)
    evaluate = evaluator(node, types, {}, np.dtype(np.float64))
    with np.errstate(all="ignore"):
        return evaluate(known, NOWHERE)


def _chosen(node: Node, known: list[Any]) -> NodeId | None:
    """The operand that a `Select` with a known condition is."""
    if not isinstance(node.op, ops.Select):
        return None
    condition, then, otherwise = node.args
    holds = known[condition]
    # elements whose conditions differ still need the selection
    if holds is None or holds.any() != holds.all():
        return None
    return then if holds.all() else otherwise


def _replaces(graph: Graph, node: Node, value: Array) -> bool:
    if isinstance(node.op, ops.Constant) or node.type.kind != "real":
        return False
    # repeated numbers are stored once, and read repeatedly
    if isinstance(node.op, ops.Broadcast) and graph[node.args[0]].type.size < node.type.size:
        return False
    # what is not finite stays as an operation, which `never_finite` warns of at its place
    return bool(np.isfinite(value).all())
