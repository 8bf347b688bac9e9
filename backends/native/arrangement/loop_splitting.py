"""Divides a training step by when it can run: before the loop over time, in it, or after it.

A loop over time is a chain: each step waits for the one before. Sums over logged samples need not:
they are done for all times at once, ahead of it. Nor need gradients of parameters: the reverse loop
leaves the few adjoints that they are made of in rows over time, and they are summed after it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import assert_never

from backends.c_lowering.use_counts import only_units_moved, use_counts
from compiler.differentiation.training_step import TrainingStep
from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.training.values import (
    KeptRow,
    LossScale,
    NewestSample,
    StateAdjoint,
    TrainingValue,
)

_MOST_ELEMENTS = 96
"""Numbers a step kept in rows, all together: 25,000 steps of 16 samples take 154 MB."""

_DEAR = 6
"""Operations an element from which on a value is kept instead of computed again."""

_LEAST_SHARE = 3
"""A gradient is summed after the loop if it has so many times the elements of its factors."""


@dataclass(frozen=True, slots=True)
class LateGradient:
    """An addend of a parameter's gradient at each time: the product of two views of rows."""

    parameter: str
    product: NodeId
    """A Multiply or Contract of the reverse graph."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Phases:
    """The nodes of each phase of a kernel; ids are those of the training step's graphs."""

    ahead: tuple[NodeId, ...]
    """Contractions of the forward graph over logged samples."""
    kept: tuple[NodeId, ...]
    """Other nodes of the forward graph that the reverse step reads instead of computing them."""
    cuts: tuple[NodeId, ...]
    """Nodes of the reverse graph that late gradients are made of."""
    late: tuple[LateGradient, ...]
    direct: tuple[tuple[str, NodeId], ...]
    """Parameters and the addends that the reverse step adds itself."""

    @property
    def rows(self) -> tuple[NodeId, ...]:
        """All nodes that stand in rows."""
        return (*self.ahead, *self.kept, *self.cuts)


def split_loops(step: TrainingStep) -> Phases:
    """The division of one training step."""
    # The order decides who gets the room in rows: sums ahead first, since they leave the chain of
    # steps altogether, then factors of late gradients, then what only saves a second computation.
    room = _Room()
    ahead = _ahead(step, room)
    # what is done ahead is no longer an operation of the step, so it makes no gradient dear
    graph = read_from_rows(step.reverse_step.graph, ahead)
    forward = len(step.program.step)
    found = step.reverse_step.gradients
    gradients = list(found.parameters.items())
    sums = Addends(graph, [*found.states.values(), *(node for _, node in gradients)])
    late: list[LateGradient] = []
    direct: list[tuple[str, NodeId]] = []
    rows: dict[NodeId, None] = {}
    for parameter, gradient in gradients:
        for addend in sums.of(gradient):
            factors = _factors_to_keep(graph, addend)
            if factors is not None and room.take(graph, factors):
                late.append(LateGradient(parameter, addend))
                # a dict keeps the order in which rows were asked for: the layout must not depend on
                # hashes
                rows |= dict.fromkeys(factors)
            else:
                # no room, or it does not pay: the reverse step adds this one at every step
                direct.append((parameter, addend))
    # late products are not roots: the reverse step computes their factors only
    roots = [*found.states.values(), *rows, *(node for _, node in direct)]
    kept = _kept(graph, forward, roots, {node for node in rows if node < forward}, room)
    cuts = tuple(node for node in rows if node >= forward)
    return Phases(ahead=ahead, kept=kept, cuts=cuts, late=tuple(late), direct=tuple(direct))


def read_from_rows(graph: Graph, nodes: Iterable[NodeId]) -> Graph:
    """The graph with some nodes read from their rows."""
    found = list(graph.nodes)
    for index in nodes:
        node = found[index]
        found[index] = Node(ops.ReadTraining(KeptRow(index)), (), node.type, node.span)
    return Graph(tuple(found))


class Addends:
    """Takes sums of nodes apart, as far as no other node needs the partial sums."""

    def __init__(self, graph: Graph, roots: Iterable[NodeId]) -> None:
        self._graph = graph
        self._demands = use_counts(graph, roots)

    def of(self, node: NodeId) -> list[NodeId]:
        """The nodes whose sum the node is."""
        found: list[NodeId] = []
        waiting = [node]
        while waiting:
            term = waiting.pop()
            # a partial sum that somebody else reads must be made anyway: it counts as one addend
            if isinstance(self._graph[term].op, ops.Add) and self._demands[term] == 1:
                # a stack gives the last one back first: reversed, the addends keep their order
                waiting += reversed(self._graph[term].args)
            else:
                found.append(term)
        return found


def is_zero(graph: Graph, node: NodeId) -> bool:
    """Whether a node is 0 everywhere, as its structure shows."""
    match graph[node].op:
        case ops.Constant(values):
            return not any(values)
        case ops.Broadcast() | ops.Reshape() | ops.Slice():
            return is_zero(graph, graph[node].args[0])
        case _:
            return False


class _Room:
    """The room that a step has for numbers in rows."""

    def __init__(self) -> None:
        self._left = _MOST_ELEMENTS
        self._taken: set[NodeId] = set()

    def take(self, graph: Graph, nodes: Iterable[NodeId]) -> bool:
        """Takes the elements of these nodes if there is room for all."""
        # a factor of two late gradients takes its row once
        new = [node for node in nodes if node not in self._taken]
        size = sum(graph[node].type.size for node in new)
        if size > self._left:
            return False
        self._left -= size
        self._taken.update(new)
        return True


def _ahead(step: TrainingStep, room: _Room) -> tuple[NodeId, ...]:
    """The contractions of parameters with logged samples."""
    graph = step.program.step
    losses = [node for term in step.losses for node in (term.total, term.count)]
    results = [state.next for state in step.program.states]
    wanted = [*step.newest.values(), *results, *(node for node in losses if node is not None)]
    found: list[NodeId] = []
    for index, demand in enumerate(use_counts(graph, wanted)):
        node = graph[index]
        if demand and isinstance(node.op, ops.Contract):
            leaves = [view_leaf(graph, arg) for arg in node.args]
            sources = [graph[leaf].op for leaf in leaves if leaf is not None]
            if (
                # a state is not there ahead of the loop, and without samples there is nothing to
                # sum
                len(sources) == 2
                and not any(isinstance(op, ops.ReadState | ops.Window) for op in sources)
                and any(isinstance(op, ops.ReadSamples) for op in sources)
                and room.take(graph, [index])
            ):
                found.append(index)
    return tuple(found)


def view_leaf(graph: Graph, node: NodeId) -> NodeId | None:
    """The leaf that a node shows under other indices: a parameter, samples, a state; else None."""
    op = graph[node].op
    match op:
        case ops.ReadTraining(value):
            return node if _stands_in_a_row(value) else None
        case ops.Leaf() | ops.Window():
            return node
        case ops.Broadcast() | ops.Slice():
            return view_leaf(graph, graph[node].args[0])
        case ops.Reshape():
            source = graph[node].args[0]
            # other reshapes change the order of the numbers in memory, and a view has fixed strides
            moved = only_units_moved(graph[source].type, graph[node].type)
            return view_leaf(graph, source) if moved else None
        case _:
            return None


def _stands_in_a_row(value: TrainingValue) -> bool:
    """Whether it is there at all times, not given to the reverse step alone."""
    match value:
        case KeptRow() | NewestSample():
            return True
        case StateAdjoint() | LossScale():
            return False
        case _:
            assert_never(value)


def _factors_to_keep(graph: Graph, node: NodeId) -> list[NodeId] | None:
    """The nodes to keep in rows to sum a product later; None if that does not pay."""
    if not isinstance(graph[node].op, ops.Multiply | ops.Contract):
        return None
    needed = {graph.unrepeated(a) for a in graph[node].args if view_leaf(graph, a) is None}
    # keeping a vector to save adding a matrix pays: n numbers a step in place of n²
    size = sum(graph[factor].type.size for factor in needed)
    return sorted(needed) if size * _LEAST_SHARE <= graph[node].type.size else None


def _kept(
    graph: Graph, forward: int, roots: Iterable[NodeId], given: set[NodeId], room: _Room
) -> tuple[NodeId, ...]:
    """Nodes of the forward part that are dear to compute again, and those given."""
    used = use_counts(graph, roots)
    direct = {
        leaf
        for index in range(forward, len(graph))
        if used[index]
        for arg in graph[index].args
        for leaf in _computed(graph, arg)
        if leaf < forward
    }
    direct |= {leaf for root in roots for leaf in _computed(graph, root) if leaf < forward}
    kept: list[NodeId] = []
    costs: list[float] = []
    for index in range(forward):
        cost = _cost(graph, index, costs)
        size = graph[index].type.size
        dear = index in direct and cost > _DEAR * size
        if index in given or (dear and room.take(graph, [index])):
            kept.append(index)
            # what is kept costs its readers nothing more
            cost = 0.0
        costs.append(cost)
    return tuple(kept)


def _computed(graph: Graph, node: NodeId) -> list[NodeId]:
    """The real values behind structure and truth values."""
    op = graph[node].op
    if isinstance(op, ops.Structure) or graph[node].type.kind == "bool":
        return [leaf for arg in graph[node].args for leaf in _computed(graph, arg)]
    return [] if isinstance(op, ops.Leaf | ops.Window) else [node]


def _cost(graph: Graph, index: NodeId, costs: list[float]) -> float:
    """About how many operations a node takes with all that only it needs."""
    node = graph[index]
    match node.op:
        case ops.Leaf() | ops.Window():
            return 0.0
        case ops.Structure():
            own = 0.0
        case ops.Apply():
            # a kernel takes about 20 operations an element, a quotient as long as 4
            own = 20.0 * node.type.size
        case ops.Divide():
            own = 4.0 * node.type.size
        case ops.Reduction():
            # of a sum the operands are many, not the result
            own = float(max(graph[arg].type.size for arg in node.args))
        case _:
            own = float(node.type.size)
    return own + sum(costs[arg] for arg in node.args)
