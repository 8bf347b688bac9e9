"""Adds nodes for selected elements of parameters, signals and other nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Node, NodeId
from compiler.ir.types import WINDOW, Axis
from compiler.passes.analyses.kept_slices import Kept


def size_along(node: Node, axis: str) -> int:
    """Number of elements along one of the node's axes."""
    return node.type.axes[node.type.position(axis)].size


def kept_axes(node: Node, chosen: Mapping[str, Kept]) -> tuple[Axis, ...]:
    """The axes of a node after selecting the chosen elements."""
    return tuple(
        Axis(axis.name, len(chosen[axis.name])) if axis.name in chosen else axis
        for axis in node.type.axes
    )


def moved(kept: Kept, distance: int) -> Kept:
    """The same elements, with indices shifted by `distance`."""
    return tuple(index + distance for index in kept)


def read_parameter(
    builder: GraphBuilder,
    node: Node,
    name: str,
    chosen: Mapping[str, Kept],
    cuts: Mapping[tuple[str, int], Kept],
) -> NodeId:
    """The chosen elements of a parameter; `cuts` are already removed from the weights."""
    named = [axis.name for axis in node.type.axes]
    cut = {axis: cuts[name, at] for at, axis in enumerate(named) if (name, at) in cuts}
    # elements removed from the file of weights are not removed again
    found = builder.parameter(name, node.type.with_axes(kept_axes(node, cut)))
    return gathered(builder, found, {a: kept for a, kept in chosen.items() if a not in cut})


def read_samples(
    builder: GraphBuilder,
    node: Node,
    op: ops.ReadSignal | ops.ReadLog,
    chosen: Mapping[str, Kept],
) -> NodeId:
    """Samples of a signal, read over the shortest window that contains the chosen ones."""
    # the window has no gaps between its oldest and newest sample, since ports are windows
    oldest, newest = chosen[WINDOW][0], chosen[WINDOW][-1]
    near = {WINDOW: tuple(range(oldest, newest + 1))}
    # a shorter window needs less memory in exports
    read = replace(op, first=op.first + oldest, last=op.first + newest)
    found = builder.emit(read, (), node.type.with_axes(kept_axes(node, near)), node.span)
    return gathered(builder, found, {**chosen, WINDOW: moved(chosen[WINDOW], -oldest)})


def gathered(builder: GraphBuilder, value: NodeId, chosen: Mapping[str, Kept]) -> NodeId:
    """The chosen elements of a value: a concatenation of slices."""
    for axis, kept in chosen.items():
        parts = [builder.slice(value, axis, *run) for run in _runs(kept)]
        value = builder.concat(parts, axis) if len(parts) > 1 else parts[0]
    return value


# zeros are inserted for sums without nonzero terms
def spread(builder: GraphBuilder, value: NodeId, axis: str, wanted: Kept, kept: Kept) -> NodeId:
    """The kept elements at their positions among the wanted ones, zeros elsewhere."""
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
    """Splits indices into runs start … stop−1 of consecutive ones."""
    runs: list[tuple[int, int]] = []
    for index in kept:
        if runs and runs[-1][1] == index:
            runs[-1] = (runs[-1][0], index + 1)
        else:
            runs.append((index, index + 1))
    return runs
