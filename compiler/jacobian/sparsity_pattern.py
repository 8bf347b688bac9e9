"""Finds the structurally nonzero elements of values: the sparsity pattern of a Jacobian."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.operations import NOWHERE, evaluator
from compiler.ir import ops
from compiler.ir.liveness import needed
from compiler.ir.program import Graph, Node, NodeId

Marks = NDArray[np.float64]
"""0 where an element is structurally 0, otherwise positive."""


def nonzero_elements(graph: Graph, values: Iterable[NodeId]) -> dict[NodeId, NDArray[np.bool_]]:
    """For each value, in the shape of its axes, False where the formula makes the element 0.

    Zeros originate in constants and propagate through products, sums and structural operations.
    Values that are read count as nonzero, and 0 · ∞ as 0.
    """
    values = list(values)
    marks: list[Any] = [None] * len(graph)
    for index, live in enumerate(needed(graph, values)):
        if live:
            marks[index] = _marks(graph, graph[index], marks)
    return {value: np.asarray(marks[value][0] > 0) for value in values}


def _marks(graph: Graph, node: Node, marks: list[Any]) -> Marks:
    """The marks of a node, (1, *shape)."""
    of = [marks[arg] for arg in node.args]
    match node.op:
        case ops.Constant(values):
            return np.reshape(np.array(values) != 0, (1, *node.type.shape)).astype(float)
        case ops.Multiply() | ops.Reduction() | ops.Structure():
            types = tuple(graph[arg].type for arg in node.args)
            # marks are ≥ 0, so that their products and sums mark products and sums
            found = evaluator(node, types, {}, np.dtype(np.float64))(marks, NOWHERE)
            return np.minimum(found, 1.0)
        case ops.Add() | ops.Subtract() | ops.Minimum() | ops.Maximum():
            return np.maximum(of[0], of[1])
        # a quotient is 0 where its dividend is: patterns ignore 0/0
        case ops.Negate() | ops.Identity() | ops.Divide():
            return of[0]
        case ops.Select():
            return np.maximum(of[1], of[2])
        case ops.Apply() | ops.Clamp() | ops.Compare() | ops.Read() | ops.Window():
            return np.ones((1, *node.type.shape))
        case _:
            assert_never(node.op)
