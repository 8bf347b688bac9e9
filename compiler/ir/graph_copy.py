"""Copies nodes from one graph into another that a pass is building."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import WINDOW


def copy_node(builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> NodeId:
    """Adds a node with new operands and the same type, place and label; reuses an equal node."""
    copied = builder.emit(node.op, args, node.type, node.span)
    if node.label is not None:
        builder.name(copied, node.label)
    return copied


def with_step(program: Program, step: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """Replaces the step graph; `copies` maps old node ids to ids in the new graph.

    It needs an entry for each node that a state, output, loss or expected range names.
    """
    return replace(
        program,
        step=step,
        states=tuple(replace(state, next=copies[state.next]) for state in program.states),
        outputs=tuple(replace(output, node=copies[output.node]) for output in program.outputs),
        losses=tuple(loss.moved(copies) for loss in program.losses),
        expected=tuple(replace(entry, node=copies[entry.node]) for entry in program.expected),
    )


def with_start(program: Program, start: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """Replaces the start graph; `copies` maps each state's start node to its new id."""
    states = tuple(replace(state, start=copies[state.start]) for state in program.states)
    return replace(program, start=start, states=states)


def samples(
    builder: GraphBuilder, value: NodeId, oldest: int, read: tuple[int, int], like: Node
) -> NodeId:
    """Slices samples t+first … t+last, `read`, out of a value whose window begins at t+oldest.

    The result has the axes of `like`, the node that read these samples before. If `like` has no
    window axis, the result is a single sample.
    """
    first, last = read
    part = builder.slice(value, WINDOW, first - oldest, last - oldest + 1)
    return builder.reshape(part, like.type.axes)
