"""Finds sums that can skip inactive fuzzy sets, and values that are then needed per element
only.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from backends.c_lowering.state_memory import StateMemory, joining, seen_values
from compiler.ir.ops import Add
from compiler.ir.program import Graph, NodeId, Program
from compiler.passes.analyses.compact_sets import (
    CompactSets,
    active_sums,
    compact_sets,
    is_positive_zero,
    supports,
)


@dataclass(frozen=True, slots=True)
class ActiveSums:
    """The values that need special treatment if only active sets are evaluated."""

    sets: dict[NodeId, CompactSets] = field(default_factory=dict[NodeId, CompactSets])
    """Degrees of membership that are computed for active sets only."""
    sums: dict[NodeId, NodeId] = field(default_factory=dict[NodeId, NodeId])
    """Sums over the terms of active sets only, with their sets."""
    parts: frozenset[NodeId] = frozenset()
    """Values that only such sums read: computed where they are used, not stored."""


def sums_of_active_sets(program: Program, memories: Iterable[StateMemory]) -> list[NodeId]:
    """The sums of a step that generated C computes over active sets only.

    An infinite or NaN term of an inactive set makes the sum NaN in the interpreter, but not in C.
    Steps with such sums have no guaranteed results.
    """
    read = seen_values(program) + [joining(memory) for memory in memories]
    return [*find_active_sums(program.step, read).sums]


def find_active_sums(graph: Graph, roots: Iterable[NodeId]) -> ActiveSums:
    """The sums whose result has the same bits without the terms that are 0.

    That requires that +0 is added to the sum (`settle_zeros`), so that a sum of zeros is +0. Fuzzy
    sets with other users are computed completely.
    """
    found = compact_sets(graph)
    support = supports(graph, found)
    sums = active_sums(graph, support)
    users = _users(graph, roots)
    sums = {node: sets for node, sets in sums.items() if _settled(graph, users[node])}
    carried: list[set[NodeId]] = [set() for _ in graph.nodes]
    # users have higher ids, so they are processed before their operands
    for index in range(len(graph) - 1, -1, -1):
        read_by = users[index]
        carried[index] = {
            sets
            for sets in support[index].values()
            # a sum along another axis needs all sets; an unused value needs none, so `read_by` is
            # tested first
            if read_by
            and all(
                user is not None and (sums.get(user) == sets or sets in carried[user])
                for user in read_by
            )
        }
    found = {node: sets for node, sets in found.items() if node in carried[node]}
    sums = {node: sets for node, sets in sums.items() if sets in found}
    parts = [index for index, sets in enumerate(carried) if not found.keys().isdisjoint(sets)]
    return ActiveSums(found, sums, frozenset(parts))


def _users(graph: Graph, roots: Iterable[NodeId]) -> list[list[NodeId | None]]:
    """The nodes that read each node; None marks a root."""
    users: list[list[NodeId | None]] = [[] for _ in graph.nodes]
    wanted = set(roots)
    for root in wanted:
        users[root].append(None)
    for index in range(len(graph) - 1, -1, -1):
        if users[index]:
            for arg in graph[index].args:
                users[arg].append(index)
    return users


def _settled(graph: Graph, users: list[NodeId | None]) -> bool:
    return bool(users) and all(
        user is not None
        and isinstance(graph[user].op, Add)
        and is_positive_zero(graph, graph[user].args[1])
        for user in users
    )
