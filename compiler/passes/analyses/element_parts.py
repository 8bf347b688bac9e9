"""Emits parts of values: chosen elements of parameters, signals and nodes, zeros among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Node, NodeId
from compiler.ir.types import WINDOW, Axis
from compiler.passes.analyses.kept_slices import Kept


def size_along(node: Node, axis: str) -> int:
    """The elements of a node along one of its axes."""
    return node.type.axes[node.type.position(axis)].size


def kept_axes(node: Node, chosen: Mapping[str, Kept]) -> tuple[Axis, ...]:
    """The axes of a node of which the chosen elements are kept."""
    return tuple(
        Axis(axis.name, len(chosen[axis.name])) if axis.name in chosen else axis
        for axis in node.type.axes
    )


def moved(kept: Kept, distance: int) -> Kept:
    """The same elements, counted from another first one."""
    return tuple(index + distance for index in kept)


def read_parameter(
    builder: GraphBuilder,
    node: Node,
    name: str,
    chosen: Mapping[str, Kept],
    cuts: Mapping[tuple[str, int], Kept],
) -> NodeId:
    """The chosen elements of a parameter, of which some may be cut from the weights already."""
    named = [axis.name for axis in node.type.axes]
    cut = {axis: cuts[name, at] for at, axis in enumerate(named) if (name, at) in cuts}
    # what is cut from the file of weights is not cut here again
    found = builder.parameter(name, node.type.with_axes(kept_axes(node, cut)))
    return gathered(builder, found, {a: kept for a, kept in chosen.items() if a not in cut})


def read_samples(
    builder: GraphBuilder,
    node: Node,
    op: ops.ReadSignal | ops.ReadLog,
    chosen: Mapping[str, Kept],
) -> NodeId:
    """Samples of a signal, read no farther back than they are needed."""
    # between its oldest and newest needed sample a window stays without holes: ports are windows
    oldest, newest = chosen[WINDOW][0], chosen[WINDOW][-1]
    near = {WINDOW: tuple(range(oldest, newest + 1))}
    # a window that reads less of the past needs less memory in what is exported
    read = replace(op, first=op.first + oldest, last=op.first + newest)
    found = builder.emit(read, (), node.type.with_axes(kept_axes(node, near)), node.span)
    return gathered(builder, found, {**chosen, WINDOW: moved(chosen[WINDOW], -oldest)})


def gathered(builder: GraphBuilder, value: NodeId, chosen: Mapping[str, Kept]) -> NodeId:
    """The chosen elements of a whole value: slices of runs, side by side."""
    for axis, kept in chosen.items():
        parts = [builder.slice(value, axis, *run) for run in _runs(kept)]
        value = builder.concat(parts, axis) if len(parts) > 1 else parts[0]
    return value


# zeros come back where a sum of nothing stands between others
def spread(builder: GraphBuilder, value: NodeId, axis: str, wanted: Kept, kept: Kept) -> NodeId:
    """The kept elements at their places among the wanted ones, zeros at the others."""
    if wanted == kept:
        return value
    type = builder.type(value)
    places = {element: place for place, element in enumerate(kept)}
    parts: list[NodeId] = []
    begin = 0
    while begin < len(wanted):
        there = wanted[begin] in places
        end = begin
        while end < len(wanted) and (wanted[end] in places) == there:
            end += 1
        if there:
            first = places[wanted[begin]]
            parts.append(builder.slice(value, axis, first, first + end - begin))
        else:
            axes = tuple(Axis(a.name, end - begin) if a.name == axis else a for a in type.axes)
            zero = builder.constant(0.0, unit=type.unit)
            parts.append(builder.broadcast(zero, axes))
        begin = end
    return builder.concat(parts, axis) if len(parts) > 1 else parts[0]


def _runs(kept: Kept) -> list[tuple[int, int]]:
    """Indices that follow each other, as the first of them and the end."""
    runs: list[tuple[int, int]] = []
    for index in kept:
        if runs and runs[-1][1] == index:
            runs[-1] = (runs[-1][0], index + 1)
        else:
            runs.append((index, index + 1))
    return runs
