"""Rewrites a graph so that single elements of its values are computed separately.

An element is a value with some axes fixed at an index. The same axes are fixed in its operands,
down to single elements of states, signals and parameters. A sum keeps the axis that it runs along,
so that a matrix product remains a loop.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW, Axis, Type
from compiler.jacobian.matrices import strided_places

Fixed = tuple[tuple[str, int], ...]
"""Fixed axes with their index, in the order of the type."""

Leaf = ops.ReadState | ops.ReadSignal | ops.ReadParameter


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafSlice:
    """A part of a state, signal or parameter (the leaf) that a node of `Elements.graph` represents:
    some axes of the leaf are fixed at an index.

    Element (i, j, …) of the part is element offset + Σ stride · index of the leaf in C order.
    """

    leaf: Leaf
    whole: Type
    """Type of the leaf."""
    fixed: Fixed
    type: Type
    offset: int
    strides: tuple[int, ...]

    def read(self, builder: GraphBuilder) -> NodeId:
        """The node of the part in another graph: a read of the leaf, followed by the selection of
        its elements.
        """
        value = builder.emit(self.leaf, (), self.whole)
        for name, index in self.fixed:
            value = builder.element(value, name, index)
        return value

    @property
    def numbers(self) -> list[int]:
        """For each element of the part, its index among the elements of the leaf in C order."""
        return strided_places(self.offset, self.type.shape, self.strides).ravel().tolist()


@dataclass(frozen=True, slots=True)
class Elements:
    """A graph in which every wanted element of other values is a separate node."""

    graph: Graph
    nodes: tuple[NodeId, ...]
    """Nodes of the wanted elements, in their order."""
    parts: dict[NodeId, LeafSlice]
    """The nodes that represent parts of leaves; no other node reads from outside the graph."""


def single_elements(graph: Graph, wanted: Iterable[tuple[NodeId, Fixed]]) -> Elements:
    """A graph in which every wanted element of values of `graph` is a node of its own.

    An element is a pair of its node and its fixed axes, each with an index. A window over a buffer
    becomes the samples of the state followed by the newest sample.
    """
    wanted = list(wanted)
    # backwards: an element requests the elements of its operands; a dict keeps the order
    # without duplicates
    needs: list[dict[Fixed, None]] = [{} for _ in graph.nodes]
    for node, fixed in wanted:
        needs[node][fixed] = None
    for index in range(len(graph) - 1, -1, -1):
        for fixed in needs[index]:
            for operand, inner in _Element(graph, index, fixed).operands():
                needs[operand][inner] = None
    # forwards: operands have smaller ids, so the elements of operands already exist
    made = _Made(graph)
    for index in range(len(graph)):
        for fixed in needs[index]:
            made.add(_Element(graph, index, fixed))
    nodes = tuple(made.known[element] for element in wanted)
    return Elements(made.builder.graph(), nodes, made.parts)


def every_element(type: Type) -> list[Fixed]:
    """All elements of a value in C order; each has an index for every axis, as pairs (axis name,
    index).
    """
    names = type.axis_names
    return [tuple(zip(names, index, strict=True)) for index in np.ndindex(*type.shape)]


@dataclass(frozen=True, slots=True)
class _Element:
    graph: Graph
    index: NodeId
    fixed: Fixed

    @property
    def node(self) -> Node:
        return self.graph[self.index]

    @property
    def type(self) -> Type:
        at = dict(self.fixed)
        return self.node.type.with_axes(tuple(a for a in self.node.type.axes if a.name not in at))

    def operands(self) -> list[tuple[NodeId, Fixed]]:
        """The elements of operands on which this element depends, as pairs (node, fixed axes), in
        the order in which `_Made` uses them.
        """
        node, at = self.node, dict(self.fixed)
        match node.op:
            case ops.Leaf():
                return []
            case ops.Reshape():
                return [(node.args[0], self._before_reshape(node.args[0]))]
            case ops.Slice(axis, start, _):
                # a slice becomes an index shift without an operation
                moved = {n: i + start if n == axis else i for n, i in at.items()}
                return [(node.args[0], self._in(node.args[0], moved))]
            case ops.Concat(axis) if axis in at:
                # only one part contains the element: derivatives by the others are structurally 0
                part, index = self._part_of(axis, at[axis])
                return [(part, self._in(part, at | {axis: index}))]
            case ops.Window():
                length = node.type.shape[-1]
                newest = (node.args[0], self._in(node.args[0], at))
                # older samples are elements of the state, which is a leaf
                return [newest] if at.get(WINDOW, length - 1) == length - 1 else []
            case _:
                return [(arg, self._in(arg, at)) for arg in node.args]

    def _in(self, operand: NodeId, at: dict[str, int]) -> Fixed:
        names = self.graph[operand].type.axis_names
        return tuple((name, at[name]) for name in names if name in at)

    def _part_of(self, axis: str, index: int) -> tuple[NodeId, int]:
        for part in self.node.args:
            type = self.graph[part].type
            size = type.shape[type.position(axis)]
            if index < size:
                return part, index
            index -= size
        raise AssertionError("an index is below the sum of the parts' lengths")

    def _before_reshape(self, operand: NodeId) -> Fixed:
        """The fixed axes of the operand of a reshape. Empty (the whole operand) if some axes are
        free and the reshape does more than rename axes.
        """
        before, after, at = self.graph[operand].type, self.node.type, dict(self.fixed)
        if len(at) == len(after.axes):
            # the C-order index of an element is the same before and after
            indices = tuple(at[axis.name] for axis in after.axes)
            number = int(np.ravel_multi_index(indices, after.shape)) if indices else 0
            found = np.unravel_index(number, before.shape)
            return tuple((a.name, int(i)) for a, i in zip(before.axes, found, strict=True))
        # some axes are free: indices correspond only if the axes keep their lengths
        old = [axis for axis in before.axes if axis.size != 1]
        new = [axis for axis in after.axes if axis.size != 1]
        # axes were joined or split: request the whole operand and select after the reshape
        if [axis.size for axis in old] != [axis.size for axis in new]:
            return ()
        renamed = {n.name: o.name for o, n in zip(old, new, strict=True)}
        return self._in(operand, {renamed[n]: i for n, i in at.items() if n in renamed})


class _Made:
    """The new graph while `single_elements` builds it: `known` has the new node of each element
    (node, fixed axes) of the old graph.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.builder = GraphBuilder()
        self.known: dict[tuple[NodeId, Fixed], NodeId] = {}
        self.parts: dict[NodeId, LeafSlice] = {}

    def add(self, element: _Element) -> None:
        operands = [self.known[operand] for operand in element.operands()]
        with self.builder.at(element.node.span):
            made = self._made(element, operands)
        # the label of the spec names the whole value only
        if not element.fixed and element.node.label is not None:
            self.builder.name(made, element.node.label)
        self.known[element.index, element.fixed] = made

    def _made(self, element: _Element, operands: list[NodeId]) -> NodeId:
        b, node, type = self.builder, element.node, element.type
        match node.op:
            case ops.ReadState() | ops.ReadSignal() | ops.ReadParameter():
                return self._part(node.op, node.type, element.fixed)
            case ops.ReadLog() | ops.ReadTraining():
                raise AssertionError("outputs and next states do not read the record")
            case ops.Constant(values):
                numbers = np.reshape(values, node.type.shape)
                at = dict(element.fixed)
                kept = tuple(at.get(axis.name, slice(None)) for axis in node.type.axes)
                # an element of a constant is a constant, so that products with it fold
                chosen = tuple(float(x) for x in np.ravel(numbers[kept]))
                return b.emit(ops.Constant(chosen), (), type)
            case ops.Broadcast():
                return b.broadcast(operands[0], type.axes)
            case ops.Reshape():
                return self._reshaped(element, operands[0])
            case ops.Slice(axis, start, stop):
                fixed = any(name == axis for name, _ in element.fixed)
                return operands[0] if fixed else b.slice(operands[0], axis, start, stop)
            case ops.Concat(axis):
                fixed = any(name == axis for name, _ in element.fixed)
                return operands[0] if fixed else b.emit(ops.Concat(axis), tuple(operands), type)
            case ops.Window(state):
                return self._window(element, state, operands)
            case ops.Elementwise() | ops.Reduction():
                return b.emit(node.op, tuple(operands), type)
            case _:
                assert_never(node.op)

    def _part(self, leaf: Leaf, whole: Type, fixed: Fixed) -> NodeId:
        at = dict(fixed)
        strides = [math.prod(whole.shape[i + 1 :]) for i in range(len(whole.shape))]
        free = [i for i, axis in enumerate(whole.axes) if axis.name not in at]
        offset = sum(at.get(a.name, 0) * s for a, s in zip(whole.axes, strides, strict=True))
        type = whole.with_axes(tuple(whole.axes[i] for i in free))
        part = LeafSlice(
            leaf=leaf,
            whole=whole,
            fixed=fixed,
            type=type,
            offset=offset,
            strides=tuple(strides[i] for i in free),
        )
        node = self.builder.emit(_stand_in(part), (), type)
        self.parts[node] = part
        return node

    def _reshaped(self, element: _Element, operand: NodeId) -> NodeId:
        """The node of an element of a reshape. `operand` is the corresponding element of its
        operand, or the whole operand, from which the element is then selected.
        """
        b = self.builder
        if b.type(operand).size == element.type.size:
            return b.reshape(operand, element.type.axes)
        value = b.reshape(operand, element.node.type.axes)
        for name, index in element.fixed:
            value = b.element(value, name, index)
        return value

    def _window(self, element: _Element, state: str, operands: list[NodeId]) -> NodeId:
        window = element.node.type
        kept = ops.ReadState(state)
        past = Type((*window.axes[:-1], Axis(WINDOW, window.shape[-1] - 1)), window.unit)
        at = dict(element.fixed)
        if WINDOW in at:
            return operands[0] if operands else self._part(kept, past, element.fixed)
        newest = self.builder.type(operands[0]).axes
        last = self.builder.reshape(operands[0], (*newest, Axis(WINDOW, 1)))
        before = self._part(kept, past, element.fixed)
        return self.builder.emit(ops.Concat(WINDOW), (before, last), element.type)


def _stand_in(part: LeafSlice) -> ops.Op:
    """A leaf with a name of its own that replaces one part of a leaf during differentiation.

    Without it, the gradient with respect to the part would include that of other parts.
    """
    place = ",".join(f"{name}={index}" for name, index in part.fixed)
    name = f"{part.leaf!r}[{place}]"
    is_parameter = isinstance(part.leaf, ops.ReadParameter)
    return ops.ReadParameter(name) if is_parameter else ops.ReadState(name)
