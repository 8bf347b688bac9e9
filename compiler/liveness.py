"""Finds the nodes that some values are made of."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.program import Graph, NodeId


def needed(graph: Graph, wanted: Iterable[NodeId]) -> list[bool]:
    """For every node whether one of the wanted values depends on it, or is it."""
    marked = [False] * len(graph)
    for node in wanted:
        marked[node] = True
    for index in range(len(graph) - 1, -1, -1):
        if marked[index]:
            for arg in graph[index].args:
                marked[arg] = True
    return marked
