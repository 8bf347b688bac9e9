"""Copies nodes from one graph into another that a pass is building."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import WINDOW


def copy_node(builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> NodeId:
    """The node with new operands, its type, place and name kept; an equal one is used again."""
    copied = builder.emit(node.op, args, node.type, node.span)
    if node.label is not None:
        builder.name(copied, node.label)
    return copied


def with_step(program: Program, step: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """The program with another step graph; `copies` tells where each named node is in it now."""
    return replace(
        program,
        step=step,
        states=tuple(replace(state, next=copies[state.next]) for state in program.states),
        outputs=tuple(replace(output, node=copies[output.node]) for output in program.outputs),
        losses=tuple(loss.moved(copies) for loss in program.losses),
        expected=tuple(replace(entry, node=copies[entry.node]) for entry in program.expected),
    )


def with_start(program: Program, start: Graph, copies: Mapping[NodeId, NodeId]) -> Program:
    """The program with another start graph; `copies` tells where each state's node is in it now."""
    states = tuple(replace(state, start=copies[state.start]) for state in program.states)
    return replace(program, start=start, states=states)


def samples(
    builder: GraphBuilder, value: NodeId, oldest: int, read: tuple[int, int], like: Node
) -> NodeId:
    """Samples t+first … t+last of a value whose window begins at t+oldest, as `like` has them.

    `like` is the node that read them before: without a window axis in its type the one sample.
    """
    first, last = read
    part = builder.slice(value, WINDOW, first - oldest, last - oldest + 1)
    return builder.reshape(part, like.type.axes)
