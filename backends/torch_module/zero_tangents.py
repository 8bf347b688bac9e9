"""Says where constants may have a tangent of 0 in forward mode: 0 · ∞ and 0 / 0 are no numbers."""

from __future__ import annotations

from backends.torch_module.lowering import static_nodes
from compiler.ir import ops
from compiler.ir.program import Graph

_FINITE = frozenset({"sin", "cos", "atan", "tanh", "sigmoid", "softplus", "abs", "sign"})
"""Functions that are finite, with finite slopes, at every number."""


def stays_finite(graph: Graph) -> bool:
    """Whether finite leaves make all values and slopes finite, but for what overflows.

    A divisor of parameters alone that is 0 makes the model itself infinite.
    """
    static = static_nodes(graph)
    for _, node in graph:
        match node.op:
            case ops.Divide() if not static[node.args[1]]:
                return False
            case ops.Apply(function) if function not in _FINITE:
                return False
            case _:
                pass
    return True
