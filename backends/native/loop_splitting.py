"""Splits a training step into parts before, inside and after the loop over time.

The loop over time is sequential: each step waits for the previous one. Sums over recorded samples
do not depend on it and are computed for all times before the loop. Gradients of parameters are
computed after the reverse loop, from the adjoints that it stores in rows over time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import assert_never

from backends.c_lowering.graph import only_units_moved, use_counts
from compiler.differentiation.training_step import TrainingStep
from compiler.ir import ops
from compiler.ir.ops import (
    Broadcast,
    KeptRow,
    LossScale,
    Multiply,
    NewestSample,
    ReadParameter,
    StateAdjoint,
    TrainingValue,
)
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import WINDOW

_MOST_ELEMENTS = 96
"""Maximum number of stored elements per step: 25,000 steps of 16 samples take 154 MB."""

_DEAR = 6
"""Minimum number of operations per element for which a value is stored instead of recomputed."""

_LEAST_SHARE = 3
"""A gradient is summed after the loop if it has at least this many times the elements of its
factors."""


@dataclass(frozen=True, slots=True)
class LateGradient:
    """A term of a parameter's gradient that is computed after the reverse loop: the sum over all
    times of a product of values that are stored in rows.
    """

    parameter: str
    product: NodeId
    """A Multiply or Contract of the reverse graph."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Phases:
    """The nodes of each part of a kernel: before, in and after the loops over time. Ids in `ahead`
    and `kept` refer to the forward graph, the others to the reverse graph, which begins with it.
    """

    ahead: tuple[NodeId, ...]
    """Contractions of the forward graph over logged samples."""
    kept: tuple[NodeId, ...]
    """Other nodes of the forward graph that the reverse step reads from rows."""
    cuts: tuple[NodeId, ...]
    """Nodes of the reverse graph that late gradients depend on."""
    late: tuple[LateGradient, ...]
    direct: tuple[tuple[str, NodeId], ...]
    """Parameters with the gradient terms that the reverse step adds itself."""

    @property
    def rows(self) -> tuple[NodeId, ...]:
        """The ids of all nodes that are stored in rows."""
        return (*self.ahead, *self.kept, *self.cuts)


def split_loops(step: TrainingStep) -> Phases:
    """Decides which nodes of a training step are computed before the loop, stored in rows, or
    summed after the reverse loop, within a limit of memory per step.
    """
    # Order of priority for memory: sums before the loop, which shorten the sequential loop, then
    # factors of late gradients, then values that would be recomputed.
    room = _Room()
    ahead = _ahead(step, room)
    # values computed ahead cost nothing in the step
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
                # a dict keeps the order: the layout must not depend on hashes
                rows |= dict.fromkeys(factors)
            else:
                # no memory left, or no gain: the reverse step adds this term in every step
                direct.append((parameter, addend))
    # late products are not roots: the reverse step computes only their factors
    roots = [*found.states.values(), *rows, *(node for _, node in direct)]
    kept = _kept(graph, forward, roots, {node for node in rows if node < forward}, room)
    cuts = tuple(node for node in rows if node >= forward)
    return Phases(ahead=ahead, kept=kept, cuts=cuts, late=tuple(late), direct=tuple(direct))


def read_from_rows(graph: Graph, nodes: Iterable[NodeId]) -> Graph:
    """The graph with each of these nodes replaced by a read of its stored value; node ids stay the
    same.
    """
    found = list(graph.nodes)
    for index in nodes:
        node = found[index]
        found[index] = Node(ops.ReadTraining(KeptRow(index)), (), node.type, node.span)
    return Graph(tuple(found))


class Addends:
    """Splits sums in a graph into their terms. A partial sum that another node or root uses is not
    split.
    """

    def __init__(self, graph: Graph, roots: Iterable[NodeId]) -> None:
        self._graph = graph
        self._demands = use_counts(graph, roots)

    def of(self, node: NodeId) -> list[NodeId]:
        """The nodes whose sum is this node, in order; only the node itself if it is no sum."""
        found: list[NodeId] = []
        waiting = [node]
        while waiting:
            term = waiting.pop()
            # a partial sum with other users is computed anyway: it counts as one term
            if isinstance(self._graph[term].op, ops.Add) and self._demands[term] == 1:
                # reversed on the stack, so that the terms keep their order
                waiting += reversed(self._graph[term].args)
            else:
                found.append(term)
        return found


def is_zero(graph: Graph, node: NodeId) -> bool:
    """True if a node is a constant of zeros, or a broadcast, reshape or slice of one."""
    match graph[node].op:
        case ops.Constant(values):
            return not any(values)
        case ops.Broadcast() | ops.Reshape() | ops.Slice():
            return is_zero(graph, graph[node].args[0])
        case _:
            return False


class _Room:
    """The memory that remains for values stored over time, as a number of elements per step."""

    def __init__(self) -> None:
        self._left = _MOST_ELEMENTS
        self._taken: set[NodeId] = set()

    def take(self, graph: Graph, nodes: Iterable[NodeId]) -> bool:
        """Reserves memory for these nodes' values; a node that already has memory needs none.
        Returns False, with nothing reserved, if too little is left.
        """
        # a factor of two late gradients needs one row
        new = [node for node in nodes if node not in self._taken]
        size = sum(graph[node].type.size for node in new)
        if size > self._left:
            return False
        self._left -= size
        self._taken.update(new)
        return True


def _ahead(step: TrainingStep, room: _Room) -> tuple[NodeId, ...]:
    """The contractions that are computed for all times before the loop, as far as `room` has memory
    for them. Both operands are leaves, one of them recorded samples and none a state.
    """
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
                # states do not exist before the loop; without samples there is nothing to sum
                len(sources) == 2
                and not any(isinstance(op, ops.ReadState | ops.Window) for op in sources)
                and any(isinstance(op, ops.ReadSamples) for op in sources)
                and room.take(graph, [index])
            ):
                found.append(index)
    return tuple(found)


def view_leaf(graph: Graph, node: NodeId) -> NodeId | None:
    """The leaf (samples, state, parameter, or stored value) of which a node is a view with other
    strides; None if computing the node needs more than such a view.
    """
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
            # other reshapes change the order of elements in memory
            moved = only_units_moved(graph[source].type, graph[node].type)
            return view_leaf(graph, source) if moved else None
        case _:
            return None


def _stands_in_a_row(value: TrainingValue) -> bool:
    """True if the value is stored for all times; False if it is passed to the reverse step only."""
    match value:
        case KeptRow() | NewestSample():
            return True
        case StateAdjoint() | LossScale():
            return False
        case _:
            assert_never(value)


def _factors_to_keep(graph: Graph, node: NodeId) -> list[NodeId] | None:
    """The nodes that must be stored in rows to sum a product over time after the loop. None if the
    node is no product or the product has too few elements for a gain.
    """
    if not isinstance(graph[node].op, ops.Multiply | ops.Contract):
        return None
    needed = {graph.unrepeated(a) for a in graph[node].args if view_leaf(graph, a) is None}
    # storing n elements per step instead of adding n² saves time
    size = sum(graph[factor].type.size for factor in needed)
    return sorted(needed) if size * _LEAST_SHARE <= graph[node].type.size else None


def _kept(
    graph: Graph, forward: int, roots: Iterable[NodeId], given: set[NodeId], room: _Room
) -> tuple[NodeId, ...]:
    """The nodes of the forward graph whose values are stored in rows, so that the reverse step does
    not recompute them. These are all nodes in `given`, and expensive ones that reverse nodes or
    `roots` read, as far as `room` has memory. The forward graph is the first `forward` nodes of
    `graph`.
    """
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
            # a stored value costs its readers nothing
            cost = 0.0
        costs.append(cost)
    return tuple(kept)


def _computed(graph: Graph, node: NodeId) -> list[NodeId]:
    """The nodes of computed real values on which a node depends through structural operations and
    bools; the node itself if it is one, nothing for a leaf.
    """
    op = graph[node].op
    if isinstance(op, ops.Structure) or graph[node].type.kind == "bool":
        return [leaf for arg in graph[node].args for leaf in _computed(graph, arg)]
    return [] if isinstance(op, ops.Leaf | ops.Window) else [node]


def _cost(graph: Graph, index: NodeId, costs: list[float]) -> float:
    """The estimated number of operations to compute a node and its operands. `costs` has the result
    for each earlier node, 0 for stored ones.
    """
    node = graph[index]
    match node.op:
        case ops.Leaf() | ops.Window():
            return 0.0
        case ops.Structure():
            own = 0.0
        case ops.Apply():
            # a kernel takes about 20 operations per element, a division about 4
            own = 20.0 * node.type.size
        case ops.Divide():
            own = 4.0 * node.type.size
        case ops.Reduction():
            # the cost of a sum depends on its operands
            own = float(max(graph[arg].type.size for arg in node.args))
        case _:
            own = float(node.type.size)
    return own + sum(costs[arg] for arg in node.args)


@dataclass(frozen=True, slots=True)
class LateAdjoint:
    """A term of the adjoint of a buffer that is source · taps, a value per step times a parameter.
    A sample gets such a term from each step at which it is in the buffer. They are added together
    when the reverse loop reaches the sample. `addend` is the node of the product.
    """

    state: str
    addend: NodeId
    source: NodeId
    """Without a window axis; otherwise with the axes of the buffer."""
    taps: NodeId
    """A view of a parameter, with the axes of the buffer."""

    @property
    def name(self) -> str:
        return f"echo_{self.addend}"


def late_adjoints(step: TrainingStep) -> tuple[LateAdjoint, ...]:
    """The terms of adjoints of buffers that can be added late. Empty if the states at t0 depend on
    parameters, since the start then needs complete adjoints of all samples.
    """
    # the start needs the adjoint of every initial sample of the buffer, but late adjoints are
    # complete for the newest sample only
    if step.reverse_start.gradients.parameters:
        return ()
    return tuple(_late_adjoints(step))


def _late_adjoints(step: TrainingStep) -> Iterator[LateAdjoint]:
    graph, found = step.reverse_step.graph, step.reverse_step.gradients
    sums = Addends(graph, (*found.states.values(), *found.parameters.values()))
    for state, gradient in found.states.items():
        if state not in step.newest:
            continue
        for addend in sums.of(gradient):
            node = graph[addend]
            if isinstance(node.op, Multiply):
                # either operand may be the parameter
                for source, taps in (node.args, node.args[::-1]):
                    before = _before_window(graph, source)
                    if before is not None and _is_parameter(graph, taps):
                        yield LateAdjoint(state, addend, before, taps)
                        break


def _before_window(graph: Graph, node: NodeId) -> NodeId | None:
    """The operand of a broadcast that adds only the window axis; None for any other node."""
    op, args = graph[node].op, graph[node].args
    if not isinstance(op, Broadcast):
        return None
    axes = graph[node].type.axes
    # other broadcast axes would have to be summed first
    spread = graph[args[0]].type.axes == axes[:-1] and axes[-1].name == WINDOW
    return args[0] if spread else None


def _is_parameter(graph: Graph, node: NodeId) -> bool:
    leaf = view_leaf(graph, node)
    return leaf is not None and isinstance(graph[leaf].op, ReadParameter)
