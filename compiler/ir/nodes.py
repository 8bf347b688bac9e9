"""Stores the nodes of a growing graph, finds the nodes that values depend on, and orders nodes."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from compiler.ir import ops
from compiler.ir.ops import Constant, Op
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Type
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import Unit


class NodeStore:
    """Adds nodes to a growing `Graph`; a node equal to an existing one is not stored again."""

    def __init__(self, graph: Graph | None = None) -> None:
        self._nodes: list[Node] = list(graph.nodes) if graph else []
        self._known: dict[_Key, NodeId] = {}
        for index, node in enumerate(self._nodes):
            # if the initial graph has equal nodes, new users take the first
            self._known.setdefault(_key(node.op, node.args, node.type), index)
        self._span: Span | None = None

    def graph(self) -> Graph:
        return Graph(tuple(self._nodes))

    @property
    def size(self) -> int:
        """The number of nodes."""
        return len(self._nodes)

    def type(self, node: NodeId) -> Type:
        return self._nodes[node].type

    def node(self, node: NodeId) -> Node:
        return self._nodes[node]

    @contextmanager
    def at(self, span: Span | None) -> Generator[None]:
        """Nodes that are added inside the `with` block get this place in the spec."""
        previous, self._span = self._span, span or self._span
        try:
            yield
        finally:
            self._span = previous

    def name(self, node: NodeId, label: str) -> None:
        """Sets the label of a node: the name of this value in the spec. An existing label stays."""
        if self._nodes[node].label is None:
            self._nodes[node] = replace(self._nodes[node], label=label)

    def set_unit(self, node: NodeId, unit: Unit | None) -> None:
        """Sets the unit of a value whose unit is unknown to the one that the spec declares."""
        current = self._nodes[node]
        # the key of the node does not change, so the same formula, repeated, finds this node
        if current.type.unit is None:
            self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def rename_unit(self, node: NodeId, unit: Unit) -> None:
        """Writes the unit of a value as the spec does: `W` instead of the derived `V*A`."""
        current = self._nodes[node]
        self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def emit(
        self, op: Op, args: tuple[NodeId, ...], type: Type, span: Span | None = None
    ) -> NodeId:
        """Returns the node with this operation, operands and type; adds it if there is none."""
        new = len(self._nodes)
        # a single lookup: hashing the key is as slow as making the node
        index = self._known.setdefault(_key(op, args, type), new)
        if index == new:
            self._nodes.append(Node(op, args, type, span or self._span))
        return index


_Key = tuple[Op, tuple[NodeId, ...], Type, bytes]


def _key(op: Op, args: tuple[NodeId, ...], type: Type) -> _Key:
    """The key of equal nodes. Constants are compared by their bits, since 0.0 == -0.0."""
    bits = np.array(op.values).tobytes() if isinstance(op, Constant) else b""
    return op, args, type, bits


def needed(graph: Graph, wanted: Iterable[NodeId]) -> list[bool]:
    """For every node of the graph, True if it is one of the `wanted` nodes or one of those depends
    on it.
    """
    marked = [False] * len(graph)
    for node in wanted:
        marked[node] = True
    # operands stand before their users: one pass from the end is enough
    for index in range(len(graph) - 1, -1, -1):
        if marked[index]:
            for arg in graph[index].args:
                marked[arg] = True
    return marked


def reads_simulation(graph: Graph, value: NodeId) -> bool:
    """True if the value depends on a simulated input, state or buffer, not only on the log."""
    return any(
        live and isinstance(node.op, ops.ReadSignal | ops.ReadState | ops.Window)
        for live, node in zip(needed(graph, [value]), graph.nodes, strict=True)
    )


def reads_log(graph: Graph, value: NodeId) -> bool:
    """True if the value depends on recorded data."""
    return any(
        live and isinstance(node.op, ops.ReadLog)
        for live, node in zip(needed(graph, [value]), graph.nodes, strict=True)
    )


def needed_over_time(
    step: Graph, following: Mapping[str, NodeId], wanted: Iterable[NodeId]
) -> tuple[list[bool], set[str]]:
    """Like `needed`, but across steps: follows each state to the node of its next value.

    Returns one flag per node of the step, and the names of the states that the wanted values depend
    on. `following` maps a state to the node of its next value.
    """
    marked, names = [False] * len(step), set[str]()
    waiting = list(wanted)
    while waiting:
        index = waiting.pop()
        if marked[index]:
            continue
        marked[index] = True
        node = step[index]
        waiting += node.args
        if isinstance(node.op, ops.ReadState | ops.Window):
            name = node.op.name if isinstance(node.op, ops.ReadState) else node.op.state
            names.add(name)
            # the state's value comes from the same graph, one step earlier
            if name in following:
                waiting.append(following[name])
    return marked, names


def states_beside_the_log(
    step: Graph, following: Mapping[str, NodeId], outputs: Iterable[NodeId]
) -> set[str]:
    """The states that depend on the log and on which no output depends.

    They exist in training only. `following` maps a state to the node of its next value.
    """
    found: set[str] = set()
    while True:
        reading = [False] * len(step)
        for index, node in step:
            match node.op:
                case ops.ReadLog():
                    reading[index] = True
                case ops.ReadState(name=name) | ops.Window(state=name):
                    reading[index] = name in found or any(reading[arg] for arg in node.args)
                case _:
                    reading[index] = any(reading[arg] for arg in node.args)
        # fixed-point iteration: a state that reads one of these states depends on the log as well
        more = {name for name, node in following.items() if reading[node]} - found
        # states that an output depends on must run in the simulation
        if not more:
            return found - needed_over_time(step, following, outputs)[1] if found else found
        found |= more


@dataclass(frozen=True, slots=True)
class Extent:
    """The range of samples t+first … t+last that a graph reads of a signal."""

    first: int
    last: int

    def union(self, other: Extent) -> Extent:
        return Extent(min(self.first, other.first), max(self.last, other.last))

    def text(self, now: str = "t") -> str:
        """The range as text, such as `t` or `t-4 … t+1`."""
        first, last = (
            now + (f"{offset:+d}" if offset else "") for offset in (self.first, self.last)
        )
        return first if first == last else f"{first} … {last}"


def extents(graph: Graph, *, log: bool) -> dict[str, Extent]:
    """The samples that the graph reads of each signal: from the log, or as inputs of the step."""
    wanted = ops.ReadLog if log else ops.ReadSignal
    ranges: dict[str, Extent] = {}
    for _, node in graph:
        if isinstance(node.op, wanted):
            extent = Extent(node.op.first, node.op.last)
            previous = ranges.get(node.op.signal)
            ranges[node.op.signal] = previous.union(extent) if previous else extent
    return ranges


def parameters_read(graph: Graph) -> frozenset[str]:
    """Names of the parameters that the graph uses."""
    return frozenset(n.op.name for _, n in graph if isinstance(n.op, ops.ReadParameter))


class CycleError(Exception):
    """Nodes that depend on each other within one step; each is listed before its user."""

    def __init__(self, nodes: tuple[NodeId, ...]) -> None:
        super().__init__(f"nodes {nodes} need each other")
        self.nodes = nodes


def evaluation_order(graph: Graph, feeds: Mapping[NodeId, NodeId]) -> list[NodeId]:
    """All nodes of the graph, each after its operands.

    `feeds[reader]` is one more node that must come before the node `reader`. The order of the graph
    is kept where that is possible. Depth-first search without recursion, in time linear in the
    number of nodes. Raises CycleError if nodes depend on each other.
    """
    order: list[NodeId] = []
    waiting, placed = set[NodeId](), [False] * len(graph)
    for root in range(len(graph)):
        # each node is on the stack twice: first to push its operands, then to be placed
        stack = [(root, False)]
        while stack:
            node, ready = stack.pop()
            if placed[node]:
                continue
            if ready:
                waiting.discard(node)
                placed[node] = True
                order.append(node)
                continue
            if node in waiting:
                raise CycleError(_cycle(stack, node))
            waiting.add(node)
            stack.append((node, True))
            needs = graph[node].args + ((feeds[node],) if node in feeds else ())
            stack.extend((need, False) for need in reversed(needs) if not placed[need])
    return order


def _cycle(stack: list[tuple[NodeId, bool]], node: NodeId) -> tuple[NodeId, ...]:
    """The nodes of a cycle, from the operand `node` to its user: the reversed path on the stack."""
    path = [waiting for waiting, ready in stack if ready]
    return tuple(reversed(path[path.index(node) :]))
