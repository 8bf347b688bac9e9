"""Rebuilds a graph so that it computes only the elements of its values that are needed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Expected, Graph, Node, NodeId
from compiler.ir.types import WINDOW, Axis
from compiler.passes.analyses.kept_slices import Kept

BoolArray = NDArray[np.bool_]
ZerosOfAxes = dict[str, BoolArray]
"""By axis, a mask of the slices that are 0; axes without zero slices are absent."""


def zero_slices(graph: Graph, arrays: Mapping[str, NDArray[np.float64]]) -> list[ZerosOfAxes]:
    """For each node a mask per axis: True for the slices whose elements are all 0 because of zeros
    in parameters.

    `arrays` are the values of learned parameters by name; other parameters count as nonzero.
    """
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
    """A mask of the terms of a sum or contraction that are 0; None if none is known to be. `found`
    is the result of `zero_slices`.
    """
    op = graph[node].op
    assert isinstance(op, ops.Reduction)
    # a term with a zero factor adds nothing
    zeros = [found[arg][op.axis] for arg in graph[node].args if op.axis in found[arg]]
    return np.any(zeros, axis=0) if zeros else None


def renamed(graph: Graph, node: Node) -> dict[str, str] | None:
    """For a reshape that only renames axes, the new name of each axis by its old one; None for a
    reshape that changes their lengths.
    """
    before, after = graph[node.args[0]].type.axes, node.type.axes
    if [axis.size for axis in before] != [axis.size for axis in after]:
        # other lengths mix elements of slices
        return None
    return {old.name: new.name for old, new in zip(before, after, strict=True)}


def size_along(node: Node, axis: str) -> int:
    """Number of elements along the axis of this name. Raises ValueError if the node has none."""
    return node.type.axes[node.type.position(axis)].size


def kept_axes(node: Node, chosen: Mapping[str, Kept]) -> tuple[Axis, ...]:
    """The axes of a node after a selection of elements; `chosen` has the selected indices by axis,
    and other axes stay whole.
    """
    return tuple(
        Axis(axis.name, len(chosen[axis.name])) if axis.name in chosen else axis
        for axis in node.type.axes
    )


def moved(kept: Kept, distance: int) -> Kept:
    """The indices `kept` plus `distance`."""
    return tuple(index + distance for index in kept)


def read_parameter(
    builder: GraphBuilder,
    node: Node,
    name: str,
    chosen: Mapping[str, Kept],
    cuts: Mapping[tuple[str, int], Kept],
) -> NodeId:
    """The node of the `chosen` elements (indices by axis) of the parameter that `node` reads.
    `cuts` are the indices, by parameter and axis position, to which its array has been cut already.
    """
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
    """The node of the `chosen` elements (indices by axis) of a signal's window; it reads the
    shortest window that contains the chosen samples.
    """
    # the window has no gaps between its oldest and newest sample, since ports are windows
    oldest, newest = chosen[WINDOW][0], chosen[WINDOW][-1]
    near = {WINDOW: tuple(range(oldest, newest + 1))}
    # a shorter window needs less memory in exports
    read = replace(op, first=op.first + oldest, last=op.first + newest)
    found = builder.emit(read, (), node.type.with_axes(kept_axes(node, near)), node.span)
    return gathered(builder, found, {**chosen, WINDOW: moved(chosen[WINDOW], -oldest)})


def gathered(builder: GraphBuilder, value: NodeId, chosen: Mapping[str, Kept]) -> NodeId:
    """The node of the elements of a value at the `chosen` indices along each axis: a concatenation
    of slices.
    """
    for axis, kept in chosen.items():
        parts = [builder.slice(value, axis, *run) for run in _runs(kept)]
        value = builder.concat(parts, axis) if len(parts) > 1 else parts[0]
    return value


# zeros are inserted for sums without nonzero terms
def spread(builder: GraphBuilder, value: NodeId, axis: str, wanted: Kept, kept: Kept) -> NodeId:
    """Extends an axis of the node `value`, whose elements have the indices `kept`, to the indices
    `wanted`: new elements are 0.
    """
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
    """Splits the ascending indices `kept` into runs of consecutive ones, as pairs (start, stop)
    with stop exclusive.
    """
    runs: list[tuple[int, int]] = []
    for index in kept:
        if runs and runs[-1][1] == index:
            runs[-1] = (runs[-1][0], index + 1)
        else:
            runs.append((index, index + 1))
    return runs


Selection = frozenset[tuple[str, Kept]]
"""The needed indices along the listed axes; other axes are needed as a whole."""

Asked = dict[tuple[str, int], set[Kept | None]]
"""By parameter and axis index, the requested indices at all reads; None for the whole axis."""

WHOLE: Selection = frozenset()


class SelectedElements:
    """Rebuilds a graph without elements that its `roots` do not need or that are 0 because of zeros
    in parameters (`zeros`).

    The constructor goes from the roots backwards and collects the needed indices of each node. It
    adds those of parameters to `asked`.
    """

    def __init__(
        self,
        graph: Graph,
        zeros: Mapping[str, NDArray[np.float64]],
        roots: Iterable[NodeId],
        asked: Asked,
    ) -> None:
        self._graph = graph
        self._zeros = zero_slices(graph, zeros)
        self._needed: list[dict[Selection, None]] = [{} for _ in graph.nodes]
        for root in roots:
            self._needed[root][WHOLE] = None
        # backwards: all users of a node have made their requests before it is visited
        for index in reversed(range(len(graph))):
            for selection in self._needed[index]:
                self._ask(index, selection, asked)
        self._copies: dict[NodeId, NodeId] = {}

    def rebuilt(self, cuts: Mapping[tuple[str, int], Kept]) -> tuple[Graph, dict[NodeId, NodeId]]:
        """The new graph, and the new ids of nodes that are needed as a whole. `cuts` are the
        indices, by parameter and axis position, to which arrays of parameters are cut.
        """
        builder = GraphBuilder()
        made: dict[tuple[NodeId, Selection], NodeId] = {}
        for index, node in self._graph:
            for selection in self._needed[index]:
                operands = self._operands(index, selection)
                # a sum without nonzero terms needs no operands
                args = [made[key] for key in zip(node.args, operands, strict=False)]
                with builder.at(node.span):
                    found = self._built(builder, index, selection, args, cuts)
                # a label names the whole value, not a part
                if selection == WHOLE and node.label and builder.type(found) == node.type:
                    builder.name(found, node.label)
                made[index, selection] = found
        self._copies = {index: found for (index, s), found in made.items() if s == WHOLE}
        return builder.graph(), self._copies

    def expected(self, entries: Iterable[Expected]) -> tuple[Expected, ...]:
        """Those of the expected ranges `entries` whose value is needed as a whole, with new node
        ids. Call `rebuilt` before.
        """
        return tuple(
            replace(entry, node=self._copies[entry.node])
            for entry in entries
            if entry.node in self._copies
        )

    # ---- what is needed

    def _ask(self, index: NodeId, selection: Selection, asked: Asked) -> None:
        node = self._graph[index]
        if isinstance(node.op, ops.ReadParameter):
            wanted = dict(selection)
            for at, axis in enumerate(node.type.axes):
                # None where a place needs the whole of an axis
                asked.setdefault((node.op.name, at), set()).add(wanted.get(axis.name))
        for arg, operand in zip(node.args, self._operands(index, selection), strict=False):
            self._needed[arg][operand] = None

    def _operands(self, index: NodeId, selection: Selection) -> list[Selection]:
        """The needed elements of each operand of the node `index`, if the elements `selection` of
        the node are needed.

        The list is empty for a reduction whose terms are all known to be 0.
        """
        node, graph = self._graph[index], self._graph
        match node.op:
            case ops.Reduction(axis):
                terms = self._terms(index)
                if terms == ():
                    # nothing of its operands is needed: it is 0
                    return []
                rows = self._rows(index, selection)
                inner = rows if terms is None else rows | {(axis, terms)}
                return [_within(graph[arg], inner) for arg in node.args]
            case ops.Elementwise() | ops.Broadcast():
                return [_within(graph[arg], selection) for arg in node.args]
            case ops.Reshape():
                names = renamed(graph, node)
                if names is None:
                    return [WHOLE]
                old = {new: name for name, new in names.items()}
                return [frozenset((old[axis], kept) for axis, kept in selection)]
            case ops.Slice(axis, start, _):
                shifted = {a: moved(kept, start) if a == axis else kept for a, kept in selection}
                # indices of the operand are shifted by the start of the slice
                return [frozenset(shifted.items())]
            case ops.Concat(axis):
                return self._parts(node, axis, selection)
            case _:
                return [WHOLE for _ in node.args]

    def _terms(self, index: NodeId) -> Kept | None:
        """The indices of the nonzero terms of the sum `index`; None if none is known to be 0."""
        zero = contracted_zeros(self._graph, index, self._zeros)
        return None if zero is None else tuple(np.flatnonzero(~zero).tolist())

    def _rows(self, index: NodeId, selection: Selection) -> Selection:
        """The elements of `selection` of the sum `index`, without those that are known to be 0."""
        chosen = dict(selection)
        for axis, zero in self._zeros[index].items():
            before = chosen.get(axis, tuple(range(len(zero))))
            chosen[axis] = tuple(element for element in before if not zero[element])
        return frozenset(chosen.items())

    def _parts(self, node: Node, axis: str, selection: Selection) -> list[Selection]:
        chosen = dict(selection)
        kept = chosen.pop(axis, None)
        rest = frozenset(chosen.items())
        if kept is None:
            return [rest for _ in node.args]
        found: list[Selection] = []
        begin = 0
        for arg in node.args:
            size = size_along(self._graph[arg], axis)
            own = tuple(i - begin for i in kept if begin <= i < begin + size)
            # a part without kept elements is requested whole and later omitted, since an empty
            # selection has no shape
            whole = len(own) in (0, size)
            found.append(rest if whole else rest | {(axis, own)})
            begin += size
        return found

    # ---- its nodes

    def _built(
        self,
        builder: GraphBuilder,
        index: NodeId,
        selection: Selection,
        args: Sequence[NodeId],
        cuts: Mapping[tuple[str, int], Kept],
    ) -> NodeId:
        node, chosen = self._graph[index], dict(selection)
        axes = kept_axes(node, chosen)
        match node.op:
            case ops.ReadParameter(name):
                return read_parameter(builder, node, name, chosen, cuts)
            case ops.ReadSignal() | ops.ReadLog() if WINDOW in chosen:
                return read_samples(builder, node, node.op, chosen)
            case ops.Reduction():
                return self._reduced(builder, index, selection, args)
            case ops.Elementwise():
                return builder.emit(node.op, tuple(args), node.type.with_axes(axes), node.span)
            case ops.Broadcast():
                return builder.broadcast(args[0], axes)
            case ops.Reshape() if renamed(self._graph, node) is not None:
                return builder.reshape(args[0], axes)
            case ops.Slice(axis, start, stop):
                if axis in chosen:
                    return args[0]
                return builder.slice(args[0], axis, start, stop)
            case ops.Concat(axis):
                return self._joined(builder, node, axis, chosen, args)
            case _:
                found = builder.emit(node.op, tuple(args), node.type, node.span)
                return gathered(builder, found, chosen)

    def _reduced(
        self, builder: GraphBuilder, index: NodeId, selection: Selection, args: Sequence[NodeId]
    ) -> NodeId:
        """The elements `selection` of the reduction `index`, computed from its nonzero terms, with
        zeros for elements that have none. `args` are the selected operands.
        """
        node, chosen = self._graph[index], dict(selection)
        axes = kept_axes(node, chosen)
        zero = builder.constant(0.0, unit=node.type.unit)
        rows = dict(self._rows(index, selection))
        # a sum without terms is the constant 0
        if not args or not all(rows.values()):
            return builder.broadcast(zero, axes)
        found = builder.emit(
            node.op, tuple(args), node.type.with_axes(kept_axes(node, rows)), node.span
        )
        for axis, kept in rows.items():
            wanted = chosen.get(axis, tuple(range(size_along(node, axis))))
            found = spread(builder, found, axis, wanted, kept)
        return found

    def _joined(
        self,
        builder: GraphBuilder,
        node: Node,
        axis: str,
        chosen: Mapping[str, Kept],
        args: Sequence[NodeId],
    ) -> NodeId:
        kept = chosen.get(axis)
        if kept is None:
            # concatenation of one operand is the operand
            return builder.concat(args, axis) if len(args) > 1 else args[0]
        begin = 0
        used: list[NodeId] = []
        for arg, made in zip(node.args, args, strict=True):
            size = size_along(self._graph[arg], axis)
            if any(begin <= i < begin + size for i in kept):
                used.append(made)
            begin += size
        return builder.concat(used, axis) if len(used) > 1 else used[0]


def _within(node: Node, selection: Selection) -> Selection:
    return frozenset((axis, kept) for axis, kept in selection if node.type.axis(axis))
