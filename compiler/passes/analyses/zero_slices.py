"""Finds the slices of each value that are 0 because learned parameters are 0."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId

BoolArray = NDArray[np.bool_]
ZerosOfAxes = dict[str, BoolArray]
"""By axis, a mask of the slices that are 0; axes without zero slices are absent."""


def zero_slices(graph: Graph, arrays: Mapping[str, NDArray[np.float64]]) -> list[ZerosOfAxes]:
    """The zero slices of every node; `arrays` are the learned parameters to consider."""
    found: list[ZerosOfAxes] = []
    for _, node in graph:
        zeros = _zeros(graph, node, found, arrays)
        found.append({axis: zero for axis, zero in zeros.items() if zero.any()})
    return found


def _zeros(
    graph: Graph,
    node: Node,
    found: list[ZerosOfAxes],
    arrays: Mapping[str, NDArray[np.float64]],
) -> ZerosOfAxes:
    of = [found[arg] for arg in node.args]
    match node.op:
        case ops.ReadParameter(name) if name in arrays:
            value = arrays[name]
            return {
                # NaN != 0 is true: a NaN is never removed
                axis.name: ~np.moveaxis(value != 0.0, at, 0).reshape(axis.size, -1).any(axis=1)
                for at, axis in enumerate(node.type.axes)
            }
        case ops.Multiply():
            return _either(*of)
        # a sum is 0 where all terms are 0, a product where any factor is 0
        case ops.Add() | ops.Subtract():
            left, right = of
            return {axis: left[axis] & right[axis] for axis in left.keys() & right.keys()}
        # 0/0 counts as 0: pruning preserves outputs only where values are finite
        case ops.Negate() | ops.Divide() | ops.Identity() | ops.Broadcast() | ops.Sum():
            return {axis: zero for axis, zero in of[0].items() if node.type.axis(axis)}
        case ops.Contract(axis):
            return {name: zero for name, zero in _either(*of).items() if name != axis}
        case ops.Reshape():
            names = renamed(graph, node)
            return {} if names is None else {names[axis]: zero for axis, zero in of[0].items()}
        case _:
            return {}


def _either(left: ZerosOfAxes, right: ZerosOfAxes) -> ZerosOfAxes:
    both = {axis: left[axis] | right[axis] for axis in left.keys() & right.keys()}
    return {**left, **right, **both}


def contracted_zeros(graph: Graph, node: NodeId, found: list[ZerosOfAxes]) -> BoolArray | None:
    """A mask of the zero terms of a sum or contraction; None if there are none."""
    op = graph[node].op
    assert isinstance(op, ops.Reduction)
    # a term with a zero factor adds nothing
    zeros = [found[arg][op.axis] for arg in graph[node].args if op.axis in found[arg]]
    return np.any(zeros, axis=0) if zeros else None


def renamed(graph: Graph, node: Node) -> dict[str, str] | None:
    """The new name of each axis if a reshape only renames them; otherwise None."""
    before, after = graph[node.args[0]].type.axes, node.type.axes
    if [axis.size for axis in before] != [axis.size for axis in after]:
        # other lengths mix elements of slices
        return None
    return {old.name: new.name for old, new in zip(before, after, strict=True)}
