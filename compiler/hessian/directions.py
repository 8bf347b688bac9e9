"""Groups variables into directions whose derivatives are computed together.

Variables that affect the same nonlinear operations and contractions share one array of tangents.
Other variables have separate arrays, so that no tangents are computed that are 0 for a whole group.
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
    """Directions start … stop−1 of a group; they are matrix columns column, column + 1, …."""

    start: int
    stop: int
    column: int


@dataclass(frozen=True, slots=True)
class Directions:
    """Variables whose elements are the directions along one axis, member after member."""

    axis: Axis
    members: tuple[Member, ...]

    def seeds(
        self, builder: GraphBuilder, leaves: Mapping[str, Sequence[NodeId]]
    ) -> dict[NodeId, NodeId]:
        """The tangents of the leaves of each member: a unit direction per element."""
        found: dict[NodeId, NodeId] = {}
        first = 0
        for member in self.members:
            # columns of the identity: the directions of the member's own elements
            values = np.eye(self.axis.size)[:, first : first + member.size]
            for leaf in leaves[member.name]:
                axes = (self.axis, *builder.type(leaf).axes)
                found[leaf] = builder.constant(values, axes, unit=None)
            first += member.size
        return found

    @property
    def runs(self) -> list[DirectionRun]:
        """The directions as matrix columns, in the smallest number of contiguous runs."""
        runs: list[DirectionRun] = []
        for member in self.members:
            start = runs[-1].stop if runs else 0
            stop = start + member.size
            # extend the run if the next column is adjacent in the matrix
            if runs and runs[-1].column + start - runs[-1].start == member.first:
                runs[-1] = DirectionRun(runs[-1].start, stop, runs[-1].column)
            else:
                runs.append(DirectionRun(start, stop, member.first))
        return runs


def grouped_directions(
    graph: Graph, members: Sequence[Member], leaves: Mapping[str, Sequence[NodeId]]
) -> list[Directions]:
    """The groups of the variables that the graph reads; `leaves` maps a variable to its reading
    nodes.
    """
    read = [member for member in members if leaves.get(member.name)]
    # sets of variables as bits of an integer, for fast unions over thousands of nodes
    bits = {leaf: 1 << i for i, member in enumerate(read) for leaf in leaves[member.name]}
    depends: list[int] = []
    decisive: list[int] = []
    for index, node in graph:
        of = [depends[arg] for arg in node.args]
        mask = bits.get(index, 0)
        for bit in of:
            mask |= bit
        depends.append(mask)
        # a contraction with one dependent operand is linear, but shares one product per group
        if mask and (bends(node, [bool(bit) for bit in of]) or isinstance(node.op, ops.Contract)):
            decisive.append(mask)
    groups: dict[tuple[int, ...], list[Member]] = {}
    for i, member in enumerate(read):
        # variables that affect the same operations have the same signature: their tangents are
        # nonzero together
        signature = tuple(place for place, mask in enumerate(decisive) if mask >> i & 1)
        groups.setdefault(signature, []).append(member)
    return [
        # axes of a spec have no quote in their names
        Directions(Axis(f"{i}'", sum(member.size for member in group)), tuple(group))
        for i, group in enumerate(groups.values())
    ]


def bends(node: Node, moving: Sequence[bool]) -> bool:
    """True if the operation can have a second derivative; `moving` flags the dependent operands."""
    match node.op:
        case ops.Multiply() | ops.Contract():
            return all(moving)
        # n/d is linear in n: it is nonlinear if d depends on the variables
        case ops.Divide():
            return moving[1]
        case ops.Apply():
            return any(moving)
        case _:
            return False
