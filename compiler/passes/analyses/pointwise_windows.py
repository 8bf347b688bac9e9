"""Finds values that apply the same function to each sample of a buffer."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW, Axis
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampled:
    """The samples of a buffer's window that a value depends on; index 0 is the oldest."""

    buffer: str
    first: int
    count: int
    with_newest: bool
    """True if it reads the window with the newest sample, not only the buffer."""
    calls: bool = False
    """True if it calls a scalar function for each sample."""


@dataclass(frozen=True, slots=True)
class Samplewise:
    """The nodes of one graph that are functions of single samples."""

    sampled: dict[NodeId, Sampled]
    fixed: frozenset[NodeId]
    """Nodes that depend on constants only, or also on parameters if these count as fixed."""


def samplewise(graph: Graph, buffers: frozenset[str], *, parameters: bool) -> Samplewise:
    """The nodes that are functions of single samples of one of the buffers."""
    sampled: dict[NodeId, Sampled] = {}
    fixed: set[NodeId] = set()
    for index, node in graph:
        match node.op:
            case ops.Constant():
                fixed.add(index)
            case ops.ReadParameter():
                # while training changes a parameter, stored values f(x) would become outdated
                if parameters:
                    fixed.add(index)
            case ops.Window(name) | ops.ReadState(name):
                if name in buffers:
                    count = node.type.axes[-1].size
                    sampled[index] = Sampled(
                        buffer=name,
                        first=0,
                        count=count,
                        with_newest=isinstance(node.op, ops.Window),
                    )
            # the log is not a buffer that the step shifts
            case ops.ReadSamples():
                pass
            case _ if all(arg in fixed for arg in node.args):
                fixed.add(index)
            case _:
                found = _sampled(graph, node, sampled, fixed)
                if found is not None:
                    sampled[index] = found
    return Samplewise(sampled, frozenset(fixed))


def at_samples(
    builder: GraphBuilder,
    graph: Graph,
    node: NodeId,
    copies: dict[NodeId, NodeId],
    samples: NodeId,
    count: int | None,
    work: Samplewise,
) -> NodeId:
    """Applies the node's function to other samples: to one, or to a window of `count`.

    `copies` maps fixed nodes to the builder's graph; missing ones are copied.
    """
    made: dict[NodeId, NodeId] = {}
    for index in _ancestors(graph, [node], work):
        found = graph[index]
        axes = tuple(axis for axis in found.type.axes if axis.name != WINDOW)
        if count is not None and found.type.window is not None:
            axes = (*axes, Axis(WINDOW, count))
        # a fixed value was broadcast to the old window: use it before the broadcast
        if index in work.fixed:
            repeated = found.type.window is not None
            fixed = _copied(builder, graph, found.args[0] if repeated else index, copies)
            made[index] = builder.broadcast(fixed, axes) if repeated else fixed
        elif isinstance(found.op, ops.Window | ops.ReadState):
            made[index] = samples
        elif isinstance(found.op, ops.Slice) and found.op.axis == WINDOW:
            # `Sampled` describes the slice; the function of one sample has none
            made[index] = made[found.args[0]]
        elif isinstance(found.op, ops.Broadcast):
            made[index] = builder.broadcast(made[found.args[0]], axes)
        else:
            with builder.at(found.span):
                args = tuple(made[arg] for arg in found.args)
                made[index] = builder.emit(found.op, args, found.type.with_axes(axes))
    return made[node]


def _ancestors(graph: Graph, wanted: list[NodeId], work: Samplewise) -> list[NodeId]:
    """The nodes that the wanted ones depend on, up to fixed ones and samples, operands first."""
    found = set[NodeId]()
    while wanted:
        index = wanted.pop()
        if index not in found:
            found.add(index)
            # the search ends at fixed nodes and windows
            if index not in work.fixed and not isinstance(graph[index].op, ops.Window):
                wanted += graph[index].args
    return sorted(found)


def _copied(
    builder: GraphBuilder, graph: Graph, wanted: NodeId, copies: dict[NodeId, NodeId]
) -> NodeId:
    """The node in the builder's graph; copies it with its operands if needed."""
    missing, waiting = set[NodeId](), [wanted]
    while waiting:
        index = waiting.pop()
        if index not in copies and index not in missing:
            missing.add(index)
            waiting += graph[index].args
    for index in sorted(missing):
        found = graph[index]
        copies[index] = copy_node(builder, found, tuple(copies[arg] for arg in found.args))
    return copies[wanted]


def _sampled(
    graph: Graph, node: Node, sampled: dict[NodeId, Sampled], fixed: set[NodeId]
) -> Sampled | None:
    match node.op:
        case ops.Slice(axis, start, stop) if axis == WINDOW:
            source = sampled.get(node.args[0])
            if source is None:
                return None
            return replace(source, first=source.first + start, count=stop - start)
        case ops.Elementwise() | ops.Broadcast():
            return _of_operands(graph, node, sampled, fixed)
        case ops.Sum(axis) | ops.Contract(axis):
            # a sum over the window mixes samples; one over another axis does not
            return None if axis == WINDOW else _of_operands(graph, node, sampled, fixed)
        case ops.Leaf() | ops.Window() | ops.Structure():
            return None
        case _:
            assert_never(node.op)


def _of_operands(
    graph: Graph, node: Node, sampled: dict[NodeId, Sampled], fixed: set[NodeId]
) -> Sampled | None:
    """The samples that all operands depend on, apart from fixed operands."""
    found = [sampled[arg] for arg in node.args if arg in sampled]
    others = [arg for arg in node.args if arg not in sampled]
    # x[t-1] + x[t] depends on two samples: f(x) requires operands with the same samples
    spans = {replace(operand, calls=False) for operand in found}
    if len(spans) != 1 or not all(arg in fixed and _repeated(graph, arg) for arg in others):
        return None
    calls = isinstance(node.op, ops.Apply) or any(operand.calls for operand in found)
    return replace(found[0], calls=calls)


def _repeated(graph: Graph, index: NodeId) -> bool:
    """True if the value is equal for every sample of a window."""
    node = graph[index]
    if node.type.window is None:
        return True
    # weights along a window differ per sample, so they cannot move before the buffer
    return isinstance(node.op, ops.Broadcast) and graph[node.args[0]].type.window is None
