"""Finds additions and products that onnxruntime removes although they have an effect.

Its NoopElimination (1.31) compares a known operand of one element with 0 or 1 in single precision,
also in double models. It drops a factor or divisor within 6e-8 of 1, and a term below 7e-46.
Weights and values that depend on them only are known. An operand with more axes than the other is
not dropped, as the result has its axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.operations import NOWHERE, evaluator
from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId

_NEUTRAL: Mapping[type, float] = {
    ops.Add: 0.0,
    ops.Subtract: 0.0,
    ops.Multiply: 1.0,
    ops.Divide: 1.0,
}
_NEAR = {0.0: 1e-44, 1.0: 1e-7}
"""Slightly larger than the values that round to the neutral element, as runtimes may round
differently."""


def near_neutral(
    graph: Graph, nodes: Sequence[NodeId], weights: Mapping[str, NDArray[np.float64]]
) -> dict[NodeId, int]:
    """The nodes with an operand that would be dropped but is not 0 or 1, with its index."""
    known: list[Any] = [None] * len(graph)
    found: dict[NodeId, int] = {}
    with np.errstate(all="ignore"):
        for index in nodes:
            node = graph[index]
            if _is_known(node, known):
                types = tuple(graph[arg].type for arg in node.args)
                known[index] = evaluator(node, types, weights, np.dtype(np.float64))(known, NOWHERE)
            neutral = _NEUTRAL.get(type(node.op))
            if neutral is None or math.prod(node.type.shape) != 1:
                continue
            for place, arg in enumerate(node.args):
                value = known[arg]
                if value is not None and 0.0 < abs(value.item() - neutral) < _NEAR[neutral]:
                    found[index] = place
    return found


def _is_known(node: Node, known: Sequence[Any]) -> bool:
    if isinstance(node.op, ops.Constant | ops.ReadParameter):
        return True
    reads = isinstance(node.op, ops.Leaf | ops.Window)
    return not reads and all(known[arg] is not None for arg in node.args)
