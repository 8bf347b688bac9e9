"""Prepares graphs of a stage: reuses values, omits zeros, finds values that can be NaN."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from compiler.hessian.step_derivatives import StepDerivatives
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.infinite_values import InfiniteValues, Sign
from compiler.ir.nodes import NodeStore, needed
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type
from compiler.jacobian.zeros import known_number, without_zeros
from compiler.passes.simplify import folded

_STRUCTURE = ops.Broadcast | ops.Reshape | ops.Identity | ops.Slice | ops.Concat
"""Operations that only rearrange or copy elements; their results are not worth saving."""
_COSTLY = ops.Apply | ops.Divide | ops.Sum | ops.Contract


@dataclass(frozen=True, slots=True)
class CutGraph:
    """The graph of the derivatives. It reads each saved intermediate result as a signal.

    `kept_signal` names these signals.
    """

    slopes: Graph
    moved: dict[NodeId, NodeId]
    """Maps each copied or saved node of the original graph to its node in `slopes`."""
    kept: tuple[NodeId, ...]
    """The nodes of the original graph whose results the values function saves, ascending."""


def kept_signal(number: int) -> str:
    """Returns the name of the signal through which the derivatives read saved node `number`."""
    return f"kept {number}"


def cut_at_values(found: StepDerivatives, roots: Sequence[NodeId]) -> CutGraph:
    """Builds the graph of the derivatives `roots` that reads costly intermediate values as signals.

    `found` has the joint graph of values and derivatives. Cheap intermediate values are computed
    again.
    """
    graph = found.graph
    of_values = needed(graph, found.values.values())
    saved = tuple(sorted(_kept(graph, roots, of_values)))
    builder = GraphBuilder()
    moved: dict[NodeId, NodeId] = {}
    # operands of saved nodes are not needed here
    live = _needed_beyond(graph, roots, frozenset(saved))
    for index, node in graph:
        if index in saved:
            number = saved.index(index)
            moved[index] = builder.signal(kept_signal(number), 0, 0, node.type)
        elif index in live:
            moved[index] = copy_node(builder, node, tuple(moved[arg] for arg in node.args))
    return CutGraph(builder.graph(), moved, saved)


def _kept(graph: Graph, roots: Iterable[NodeId], of_values: list[bool]) -> set[NodeId]:
    """Returns the nodes to save: the first costly value on each path from a root to the leaves.
    `of_values` marks the nodes on which values depend.
    """
    costly: list[bool] = []
    for _, node in graph:
        # a node is costly, too, if one of its operands is
        costly.append(isinstance(node.op, _COSTLY) or any(costly[arg] for arg in node.args))
    saved: set[NodeId] = set()
    seen: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index in seen:
            continue
        seen.add(index)
        node = graph[index]
        # conditions are cheap, and the array of saved values holds no bools
        is_value = of_values[index] and costly[index] and node.type.kind == "real"
        if is_value and not isinstance(node.op, _STRUCTURE):
            saved.add(index)
        else:
            waiting += node.args
    return saved


def _needed_beyond(graph: Graph, roots: Iterable[NodeId], saved: frozenset[NodeId]) -> set[NodeId]:
    """Returns the nodes that the roots depend on, without the operands of saved nodes."""
    live: set[NodeId] = set()
    waiting = list(roots)
    while waiting:
        index = waiting.pop()
        if index not in live:
            live.add(index)
            waiting += () if index in saved else graph[index].args
    return live


_BOUNDED = frozenset({"atan", "atan2", "tanh", "sigmoid", "sign"})
_AS_LARGE = frozenset({"abs", "softplus", "sin", "cos"})
"""Functions that grow at most as their argument does; sin and cos are NaN if it overflows."""
_NOT_BELOW = (Sign.NOT_NEGATIVE, Sign.POSITIVE)


def can_end(graph: Graph, roots: Iterable[NodeId], most_factors: float) -> bool:
    """Returns True if a root may be NaN or infinite.

    That is so if its exponent of growth exceeds `most_factors`, the number of largest possible
    factors whose product is still finite. The exponent is ∞ for values that are undefined
    somewhere or grow faster than any power.
    """
    signs = InfiniteValues(NodeStore(graph))
    factors: list[float] = []
    for _, node in graph:
        # operands precede their users
        factors.append(_factors(graph, node, [factors[arg] for arg in node.args], signs))
    return any(factors[root] > most_factors for root in roots)


def _factors(graph: Graph, node: Node, of: list[float], signs: InfiniteValues) -> float:
    """Returns a value's exponent of growth from those of its operands, `of`; 0 if constant."""
    match node.op:
        case ops.ReadSignal() | ops.ReadLog() | ops.ReadState() | ops.Window():
            return max([1.0, *of])
        case ops.Multiply() | ops.Contract():
            return sum(of)
        case ops.Divide() if of[1] == 0.0 or signs.is_never_zero(node.args[1]):
            return of[0]
        case ops.Apply() if any(of):
            return _of_function(graph, node, of, signs.sign(node.args[0]))
        case ops.Divide():
            return math.inf
        case ops.Compare():
            return 0.0
        case ops.Clamp() | ops.Select():
            # of[0], the clamped value or the condition, matters only if it can be NaN
            return max(of) if math.inf in of else max(of[1:])
        case _:
            return max(of, default=0.0)


def _of_function(graph: Graph, node: Node, of: list[float], sign: Sign) -> float:
    """Returns the exponent of growth of a scalar function; `sign` is that of its first argument."""
    assert isinstance(node.op, ops.Apply)
    function = node.op.function
    if math.inf in of:
        return math.inf
    if function in _BOUNDED:
        # not 0, the exponent of constants: a bounded value can be 0 and a divisor
        return 1.0
    if function in _AS_LARGE:
        return of[0]
    exponent = graph[node.args[-1]].op
    match function:
        case "sqrt" if sign in _NOT_BELOW:
            return of[0]
        case "log" if sign is Sign.POSITIVE:
            return of[0]
        case "pow" if sign in _NOT_BELOW and isinstance(exponent, ops.Constant):
            if sign is Sign.POSITIVE or min(exponent.values) >= 0.0:
                return of[0] * max(1.0, *exponent.values)
        case _:
            pass
    return math.inf


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
    """Adds a copy of a node whose operands are already copied. Reads of states become partly 0,
    sums over zeros shorter.
    """
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
