"""Decides if constants may have zero tangents in forward mode, as 0 · ∞ and 0 / 0 are NaN."""

from __future__ import annotations

from backends.torch_module.lowering import static_nodes
from compiler.ir import ops
from compiler.ir.program import Graph

_FINITE = frozenset({"sin", "cos", "atan", "tanh", "sigmoid", "softplus", "abs", "sign"})
"""Functions that are finite, with finite derivatives, everywhere."""


def stays_finite(graph: Graph) -> bool:
    """True if finite inputs give finite values and derivatives, except for overflow.

    A divisor that depends on parameters only does not count: at 0 the model itself is infinite.
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
