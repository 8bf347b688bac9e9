"""Simplifies the graph of a stage's values for state elements that are 0: sums omit them.

before:  y = Σ w · [u₋₂₉ … u₀]        after, with u₋₂₉ … u₋₁ = 0:  y = w₂₉ u₀
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type
from compiler.jacobian.zeros import known_number, without_zeros
from compiler.passes.simplify import folded

Zeros = Mapping[str, tuple[bool, ...]]
"""For each state, by name, a mask of its elements that are 0, in C order."""


def values_at_zero(
    graph: Graph, roots: Sequence[NodeId], fixed: Sequence[NodeId], zeros: Zeros
) -> tuple[Graph, dict[NodeId, NodeId]] | None:
    """Returns the graph of the `roots` with the elements in `zeros` set to 0, and each root's node.

    Returns None in three cases. The sums over these elements would remain; one of the `fixed`
    nodes, whose values must not change, depends on them; rows of a state differ in their zeros.
    """
    if _depends(graph, fixed, zeros) or not _alike_in_rows(graph, zeros):
        return None
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        with builder.at(node.span):
            copies[index] = _copy(builder, replace(node, args=args), zeros)
    lean = GraphBuilder()
    copied_roots = {root: copies[root] for root in roots}
    moved = without_zeros(builder.graph(), list(copied_roots.values()), lean)
    # a concatenation with zeros remains: sums over it would be as long as before
    if any(_is_partly_zero(lean, node) for _, node in lean.graph()):
        return None
    simplified, places = folded(lean.graph())
    return simplified, {root: places[moved[copy]] for root, copy in copied_roots.items()}


def _depends(graph: Graph, nodes: Sequence[NodeId], zeros: Zeros) -> bool:
    """Returns True if any of the nodes depends on a state with elements set to 0."""
    dependent: set[NodeId] = set()
    for index, node in graph:
        is_leaf = isinstance(node.op, ops.ReadState) and any(zeros.get(node.op.name, ()))
        if is_leaf or any(arg in dependent for arg in node.args):
            dependent.add(index)
    return any(node in dependent for node in nodes)


def _alike_in_rows(graph: Graph, zeros: Zeros) -> bool:
    """Returns True if each state has the same mask of zeros in all its rows (last axis)."""
    reads = ((node.op.name, node.type) for _, node in graph if isinstance(node.op, ops.ReadState))
    # `_read` slices along the last axis, through all rows
    return all(
        zeros[name] == zeros[name][: type.shape[-1]] * (type.size // type.shape[-1])
        for name, type in reads
        if any(zeros.get(name, ())) and type.axes
    )


def _copy(builder: GraphBuilder, node: Node, zeros: Zeros) -> NodeId:
    """Copies a node whose operands are already copied; reads become partly 0, sums shorter."""
    match node.op:
        case ops.ReadState(name) if any(zeros.get(name, ())):
            return _read(builder, node, zeros[name])
        case ops.Contract(axis) | ops.Sum(axis):
            return _summed(builder, node, axis)
        case ops.Concat(axis):
            parts = [part for arg in node.args for part in _parts(builder, arg, axis)]
            return builder.concat(parts, axis)
        case _:
            return copy_node(builder, node, node.args)


def _zeros(builder: GraphBuilder, type: Type) -> NodeId:
    """Adds an array of zeros of this type."""
    return builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)


def _read(builder: GraphBuilder, node: Node, are_zero: tuple[bool, ...]) -> NodeId:
    """Adds the read of a state as a concatenation, along the last axis, of slices and zeros."""
    if all(are_zero):
        return _zeros(builder, node.type)
    read = copy_node(builder, node, ())
    axis = node.type.axes[-1]
    # indices at which zeros begin or end
    edges = [at for at in range(1, axis.size) if are_zero[at] != are_zero[at - 1]]
    parts: list[NodeId] = []
    for start, stop in zip([0, *edges], [*edges, axis.size], strict=True):
        part = builder.slice(read, axis.name, start, stop)
        parts.append(_zeros(builder, builder.type(part)) if are_zero[start] else part)
    return builder.concat(parts, axis.name)


def _parts(builder: GraphBuilder, value: NodeId, axis: str) -> tuple[NodeId, ...]:
    """Returns the operands of a concatenation along this axis, otherwise the value alone."""
    node = builder.node(value)
    return node.args if node.op == ops.Concat(axis) else (value,)


def _summed(builder: GraphBuilder, node: Node, axis: str) -> NodeId:
    """Adds a sum or contraction without the parts that are 0.

    It splits the first operand that is a concatenation with zeros into one term per other part.
    """
    all_parts = [_parts(builder, arg, axis) for arg in node.args]
    zeros = [[known_number(builder, part) == 0.0 for part in parts] for parts in all_parts]
    # zeros in one operand suffice: their products are 0
    number = next((at for at, known in enumerate(zeros) if any(known)), None)
    if number is None:
        return copy_node(builder, node, node.args)
    total: NodeId | None = None
    begin = 0
    for part, is_zero in zip(all_parts[number], zeros[number], strict=True):
        of = builder.type(part)
        size = of.axes[of.position(axis)].size
        if not is_zero:
            args = [
                part if at == number else builder.slice(other, axis, begin, begin + size)
                for at, other in enumerate(node.args)
            ]
            term = copy_node(builder, node, tuple(args))
            total = term if total is None else builder.add(total, term)
        begin += size
    return _zeros(builder, node.type) if total is None else total


def _is_partly_zero(builder: GraphBuilder, node: Node) -> bool:
    """Returns True for a concatenation with an operand that is 0."""
    return isinstance(node.op, ops.Concat) and any(
        known_number(builder, arg) == 0.0 for arg in node.args
    )
