"""Finds sums that may skip inactive fuzzy sets, and the values that then exist by element only."""

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
    """The values that a function treats in its own way which evaluates active sets only."""

    sets: dict[NodeId, CompactSets] = field(default_factory=dict[NodeId, CompactSets])
    """Degrees of membership of which only those of active sets are computed."""
    sums: dict[NodeId, NodeId] = field(default_factory=dict[NodeId, NodeId])
    """Sums of the terms of active sets only, and those sets."""
    parts: frozenset[NodeId] = frozenset()
    """Values that only such sums read: computed where they are used, never kept."""


def sums_of_active_sets(program: Program, memories: Iterable[StateMemory]) -> list[NodeId]:
    """The sums of a step of which generated C computes the terms of active sets only.

    An infinite or NaN term of another set makes the sum NaN in the interpreter, not in C: nothing
    is promised of a step in which one of these sums is not finite.
    """
    read = seen_values(program) + [joining(memory) for memory in memories]
    return [*find_active_sums(program.step, read).sums]


def find_active_sums(graph: Graph, roots: Iterable[NodeId]) -> ActiveSums:
    """The sums whose result has the same bits without the terms that are 0.

    That is so where +0 is added to the sum (`settle_zeros`), so that a sum of zeros has no sign.
    Fuzzy sets that something else reads too are computed as they are.
    """
    found = compact_sets(graph)
    support = supports(graph, found)
    sums = active_sums(graph, support)
    users = _users(graph, roots)
    sums = {node: sets for node, sets in sums.items() if _settled(graph, users[node])}
    carried: list[set[NodeId]] = [set() for _ in graph.nodes]
    # users have higher numbers: what they carry is known when their operand is looked at
    for index in range(len(graph) - 1, -1, -1):
        read_by = users[index]
        carried[index] = {
            sets
            for sets in support[index].values()
            # a sum along another axis asks for the sets that are 0 too
            # a value that nobody reads carries nothing: `all` of nothing would be true
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
    """The nodes that read each node; None where the surroundings do."""
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
