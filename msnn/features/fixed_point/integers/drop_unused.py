"""Removes unused integer nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from msnn.features.fixed_point.integers.program import IntegerNode, IntegerProgram


def without_unused(program: IntegerProgram) -> IntegerProgram:
    """The program with only the nodes on which outputs and memories depend."""
    roots = [n for _, nodes in program.outputs for n in nodes]
    roots += [n for memory in program.memories for n in memory.next]
    step, places = reached(program.step, roots)
    # what is checked is also used, within its range
    expected = tuple(
        replace(entry, nodes=tuple(places[node] for node in entry.nodes))
        for entry in program.expected
        if entry.nodes and all(node in places for node in entry.nodes)
    )
    start, firsts = reached(program.start, [n for m in program.memories for n in m.start])
    return replace(
        program,
        step=step,
        start=start,
        expected=expected,
        outputs=tuple(
            (port, tuple(places[node] for node in nodes)) for port, nodes in program.outputs
        ),
        memories=tuple(
            replace(
                memory,
                next=tuple(places[node] for node in memory.next),
                start=tuple(firsts[node] for node in memory.start),
            )
            for memory in program.memories
        ),
    )


def reached(
    nodes: tuple[IntegerNode, ...], roots: Iterable[int]
) -> tuple[tuple[IntegerNode, ...], dict[int, int]]:
    """The nodes on which the given ones depend, including these, and the new index of each node."""
    wanted = set(roots)
    # operands stand before their users: one pass from the end finds all that is needed
    for index in range(len(nodes) - 1, -1, -1):
        if index in wanted:
            wanted.update(nodes[index].args)
    places = {old: new for new, old in enumerate(sorted(wanted))}
    kept = [nodes[old] for old in sorted(wanted)]
    return tuple(replace(n, args=tuple(places[a] for a in n.args)) for n in kept), places
