"""Rebuilds a graph with only those elements of its values that are needed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Expected, Graph, Node, NodeId
from compiler.ir.types import WINDOW
from compiler.passes.analyses.element_parts import (
    gathered,
    kept_axes,
    moved,
    read_parameter,
    read_samples,
    size_along,
    spread,
)
from compiler.passes.analyses.kept_slices import Kept
from compiler.passes.analyses.zero_slices import contracted_zeros, renamed, zero_slices

Selection = frozenset[tuple[str, Kept]]
"""The needed indices along the listed axes; other axes are needed as a whole."""

Asked = dict[tuple[str, int], set[Kept | None]]
"""By parameter and axis index, the requested indices at all reads; None for the whole axis."""

WHOLE: Selection = frozenset()


class SelectedElements:
    """Finds the needed selections of each node of a graph, starting at its roots, and rebuilds
    it.
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
        """The graph with cut parameters, and the new ids of values that are needed as a whole."""
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
        """The expected ranges of values that are needed as a whole."""
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
        """The needed selection of each operand of a node, if `selection` of the node is needed.

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
        """The nonzero terms of a sum; None if there are no zeros."""
        zero = contracted_zeros(self._graph, index, self._zeros)
        return None if zero is None else tuple(np.flatnonzero(~zero).tolist())

    def _rows(self, index: NodeId, selection: Selection) -> Selection:
        """The needed nonzero elements of a sum along each axis that has zeros."""
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
        """A sum of the nonzero terms, with zeros for elements without any."""
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
