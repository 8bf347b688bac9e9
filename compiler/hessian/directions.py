"""Groups variables into directions along which slopes are computed together.

Variables that the same operations depend on, as far as these bend or are sums of products, share
the axis of one array of tangents; others have arrays of their own, so that no tangent is computed
where it is known to be 0 for a whole group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.types import Axis
from compiler.jacobian.matrices import Member


@dataclass(frozen=True, slots=True)
class DirectionRun:
    """Directions start … stop−1 of a group, which are variables column, column + 1, …."""

    start: int
    stop: int
    column: int


@dataclass(frozen=True, slots=True)
class Directions:
    """Variables whose numbers are the directions along one axis, member after member."""

    axis: Axis
    members: tuple[Member, ...]

    def seeds(
        self, builder: GraphBuilder, leaves: Mapping[str, Sequence[NodeId]]
    ) -> dict[NodeId, NodeId]:
        """The tangents of the leaves of each member: a 1 in the direction of every number."""
        found: dict[NodeId, NodeId] = {}
        first = 0
        for member in self.members:
            # columns of the identity: each member has the directions that stand for its own numbers
            values = np.eye(self.axis.size)[:, first : first + member.size]
            for leaf in leaves[member.name]:
                axes = (self.axis, *builder.type(leaf).axes)
                found[leaf] = builder.constant(values, axes, unit=None)
            first += member.size
        return found

    @property
    def runs(self) -> list[DirectionRun]:
        """The directions as columns of a matrix, as few runs as there can be."""
        runs: list[DirectionRun] = []
        for member in self.members:
            start = runs[-1].stop if runs else 0
            stop = start + member.size
            # a run goes on where the next column follows in the matrix too
            if runs and runs[-1].column + start - runs[-1].start == member.first:
                runs[-1] = DirectionRun(runs[-1].start, stop, runs[-1].column)
            else:
                runs.append(DirectionRun(start, stop, member.first))
        return runs


def grouped_directions(
    graph: Graph, members: Sequence[Member], leaves: Mapping[str, Sequence[NodeId]]
) -> list[Directions]:
    """The groups of the variables that the graph reads; `leaves` has the nodes that read each."""
    read = [member for member in members if leaves.get(member.name)]
    # sets of variables as the bits of an integer: a graph has thousands of nodes, and uniting two
    # sets is one operation
    bits = {leaf: 1 << i for i, member in enumerate(read) for leaf in leaves[member.name]}
    depends: list[int] = []
    decisive: list[int] = []
    for index, node in graph:
        of = [depends[arg] for arg in node.args]
        mask = bits.get(index, 0)
        for bit in of:
            mask |= bit
        depends.append(mask)
        # with one operand that moves a contraction is linear, but tangents of one group go through
        # it as one product
        if mask and (bends(node, [bool(bit) for bit in of]) or isinstance(node.op, ops.Contract)):
            decisive.append(mask)
    groups: dict[tuple[int, ...], list[Member]] = {}
    for i, member in enumerate(read):
        # variables that the same operations bend have the same signature: their tangents are 0 or
        # not together
        signature = tuple(place for place, mask in enumerate(decisive) if mask >> i & 1)
        groups.setdefault(signature, []).append(member)
    return [
        # no axis of a spec has a name with a quote
        Directions(Axis(f"{i}'", sum(member.size for member in group)), tuple(group))
        for i, group in enumerate(groups.values())
    ]


def bends(node: Node, moving: Sequence[bool]) -> bool:
    """Whether an operation whose moving operands are these can have a second slope."""
    match node.op:
        case ops.Multiply() | ops.Contract():
            return all(moving)
        # n/d is linear in n: it bends where d moves
        case ops.Divide():
            return moving[1]
        case ops.Apply():
            return any(moving)
        case _:
            return False
