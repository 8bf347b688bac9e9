"""Finds the nodes, states, parameters and samples of signals that values depend on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from compiler.ir import ops
from compiler.ir.program import Graph, NodeId
from spec_schema.late_dataclass import dataclass


def needed(graph: Graph, wanted: Iterable[NodeId]) -> list[bool]:
    """For every node, True if one of the wanted values depends on it or is that node."""
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
