"""Evaluates a node that depends on constants only."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, evaluator
from compiler.ir.liveness import needed
from compiler.ir.program import Graph, NodeId


def constant_value(graph: Graph, node: NodeId) -> Array:
    """The float64 value of a node, in the shape of its axes; it must not depend on signals or
    states.
    """
    values: list[Any] = [None] * len(graph)
    with np.errstate(all="ignore"):
        for index, live in enumerate(needed(graph, [node])):
            if live:
                types = tuple(graph[arg].type for arg in graph[index].args)
                evaluate = evaluator(graph[index], types, {}, np.dtype(np.float64))
                values[index] = evaluate(values, NOWHERE)
    # the batch has size 1, since the value reads nothing
    return values[node][0]
