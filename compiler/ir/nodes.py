"""`NodeStore` collects the nodes of a growing graph. Functions find the nodes on which values
depend, the samples that a graph reads, and an order in which nodes can be evaluated.
"""

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
    """Adds nodes to a growing `Graph`; a node equal to an existing one is not stored again. With an
    initial graph, the store begins with its nodes, under the same ids.
    """

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
        """The number of nodes stored so far; the next new node gets it as id."""
        return len(self._nodes)

    def type(self, node: NodeId) -> Type:
        return self._nodes[node].type

    def node(self, node: NodeId) -> Node:
        return self._nodes[node]

    @contextmanager
    def at(self, span: Span | None) -> Generator[None]:
        """Nodes that are added inside the `with` block get the place `span` in the spec; None
        leaves the place of the enclosing block.
        """
        previous, self._span = self._span, span or self._span
        try:
            yield
        finally:
            self._span = previous

    def name(self, node: NodeId, label: str) -> None:
        """Sets the label of a node: the name that its value has in the spec. A node that has a
        label keeps it.
        """
        if self._nodes[node].label is None:
            self._nodes[node] = replace(self._nodes[node], label=label)

    def set_unit(self, node: NodeId, unit: Unit | None) -> None:
        """Gives the unit that the spec declares to a node whose unit is unknown. A known unit
        remains.
        """
        current = self._nodes[node]
        # the key of the node does not change, so the same formula, repeated, finds this node
        if current.type.unit is None:
            self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def rename_unit(self, node: NodeId, unit: Unit) -> None:
        """Replaces the unit of a node by an equal one in the form that the spec uses: `W` instead
        of the derived `V*A`.
        """
        current = self._nodes[node]
        self._nodes[node] = replace(current, type=current.type.with_unit(unit))

    def emit(
        self, op: Op, args: tuple[NodeId, ...], type: Type, span: Span | None = None
    ) -> NodeId:
        """Returns the id of the node with operation `op`, operands `args` and this type; adds the
        node if there is none. A new node gets the place `span`, or that of the enclosing `at`.
        """
        new = len(self._nodes)
        # a single lookup: hashing the key is as slow as making the node
        index = self._known.setdefault(_key(op, args, type), new)
        if index == new:
            self._nodes.append(Node(op, args, type, span or self._span))
        return index


_Key = tuple[Op, tuple[NodeId, ...], Type, bytes]


def _key(op: Op, args: tuple[NodeId, ...], type: Type) -> _Key:
    """The dictionary key by which equal nodes are found. Constants are compared by their bits,
    since 0.0 == -0.0 although 1/0.0 and 1/-0.0 differ.
    """
    bits = np.array(op.values).tobytes() if isinstance(op, Constant) else b""
    return op, args, type, bits


def needed(graph: Graph, wanted: Iterable[NodeId]) -> list[bool]:
    """One flag per node of the graph: True if it is one of the `wanted` nodes or one of them
    depends on it.
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
    """True if the value of the node depends on an input of the step, a state or a buffer, not only
    on the log, parameters and constants.
    """
    return any(
        live and isinstance(node.op, ops.ReadSignal | ops.ReadState | ops.Window)
        for live, node in zip(needed(graph, [value]), graph.nodes, strict=True)
    )


def reads_log(graph: Graph, value: NodeId) -> bool:
    """True if the value of the node depends on recorded data (`ReadLog`)."""
    return any(
        live and isinstance(node.op, ops.ReadLog)
        for live, node in zip(needed(graph, [value]), graph.nodes, strict=True)
    )


def needed_over_time(
    step: Graph, following: Mapping[str, NodeId], wanted: Iterable[NodeId]
) -> tuple[list[bool], set[str]]:
    """Like `needed`, but across steps: a value that depends on a state also depends on the node
    that computes the state's next value.

    `following` maps a state to this node. Returns one flag per node of the graph `step`, and the
    names of the states on which the `wanted` nodes depend.
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
    """The names of the states that depend on recorded data and on which no output depends. They
    exist in training only.

    `following` maps a state to the node of its next value in `step`; `outputs` are the output
    nodes.
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
    """The samples t+first … t+last, the range of all samples of one signal that a graph reads."""

    first: int
    last: int

    def union(self, other: Extent) -> Extent:
        return Extent(min(self.first, other.first), max(self.last, other.last))

    def text(self, now: str = "t") -> str:
        """The range as text, such as `t` or `t-4 … t+1`; `now` replaces the letter t."""
        first, last = (
            now + (f"{offset:+d}" if offset else "") for offset in (self.first, self.last)
        )
        return first if first == last else f"{first} … {last}"


def extents(graph: Graph, *, log: bool) -> dict[str, Extent]:
    """The range of samples that the graph reads, by the name of the signal. `log` selects the reads
    of recorded samples (`ReadLog`), otherwise those of inputs of the step (`ReadSignal`).
    """
    wanted = ops.ReadLog if log else ops.ReadSignal
    ranges: dict[str, Extent] = {}
    for _, node in graph:
        if isinstance(node.op, wanted):
            extent = Extent(node.op.first, node.op.last)
            previous = ranges.get(node.op.signal)
            ranges[node.op.signal] = previous.union(extent) if previous else extent
    return ranges


def parameters_read(graph: Graph) -> frozenset[str]:
    """Names of the parameters that the graph reads."""
    return frozenset(n.op.name for _, n in graph if isinstance(n.op, ops.ReadParameter))


class CycleError(Exception):
    """Raised if nodes depend on each other within one step. `nodes` are the nodes of the cycle,
    each before a node that uses it.
    """

    def __init__(self, nodes: tuple[NodeId, ...]) -> None:
        super().__init__(f"nodes {nodes} need each other")
        self.nodes = nodes


def evaluation_order(graph: Graph, feeds: Mapping[NodeId, NodeId]) -> list[NodeId]:
    """The ids of all nodes of the graph, each after its operands, in the order of the graph where
    that is possible.

    `feeds[reader]` is one more node that must come before the node `reader`. Depth-first search
    without recursion, in time linear in the number of nodes. Raises CycleError if nodes depend on
    each other.
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
    """The nodes of a cycle, each before its user, when the search meets `node` a second time.
    `stack` is that of `evaluation_order`: nodes, with True for those whose operands are being
    visited.
    """
    path = [waiting for waiting, ready in stack if ready]
    return tuple(reversed(path[path.index(node) :]))
