"""Checks if a value of a stage can be NaN or infinite at states and controls the solver may try.

Iterates may leave the ranges that a spec declares, so these do not count. The check bounds the
growth of every value by a power of the states and controls: products add the exponents of their
factors. Square roots, quotients, logarithms and powers are finite only where the signs of their
operands guarantee it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from compiler.ir import ops
from compiler.ir.infinite_values import InfiniteValues, Sign
from compiler.ir.nodes import NodeStore
from compiler.ir.program import Graph, Node, NodeId

_BOUNDED = frozenset({"atan", "atan2", "tanh", "sigmoid", "sign"})
_AS_LARGE = frozenset({"abs", "softplus", "sin", "cos"})
"""Functions that grow at most as their argument does; sin and cos are NaN if it overflows."""
_NOT_BELOW = (Sign.NOT_NEGATIVE, Sign.POSITIVE)


def can_end(graph: Graph, roots: Iterable[NodeId], most_factors: float) -> bool:
    """Returns True if a root may be NaN or infinite.

    That is so if its exponent of growth exceeds `most_factors`, the number of largest possible
    factors whose product is still finite. The exponent is ∞ for values that are undefined
    somewhere or grow faster than any power.
    """
    signs = InfiniteValues(NodeStore(graph))
    factors: list[float] = []
    for _, node in graph:
        # operands precede their users
        factors.append(_factors(graph, node, [factors[arg] for arg in node.args], signs))
    return any(factors[root] > most_factors for root in roots)


def _factors(graph: Graph, node: Node, of: list[float], signs: InfiniteValues) -> float:
    """Returns a value's exponent of growth from those of its operands, `of`; 0 if constant."""
    match node.op:
        case ops.ReadSignal() | ops.ReadLog() | ops.ReadState() | ops.Window():
            return max([1.0, *of])
        case ops.Multiply() | ops.Contract():
            return sum(of)
        case ops.Divide() if of[1] == 0.0 or signs.is_never_zero(node.args[1]):
            return of[0]
        case ops.Apply() if any(of):
            return _of_function(graph, node, of, signs.sign(node.args[0]))
        case ops.Divide():
            return math.inf
        case ops.Compare():
            return 0.0
        case ops.Clamp() | ops.Select():
            # of[0], the clamped value or the condition, matters only if it can be NaN
            return max(of) if math.inf in of else max(of[1:])
        case _:
            return max(of, default=0.0)


def _of_function(graph: Graph, node: Node, of: list[float], sign: Sign) -> float:
    """Returns the exponent of growth of a scalar function; `sign` is that of its first argument."""
    assert isinstance(node.op, ops.Apply)
    function = node.op.function
    if math.inf in of:
        return math.inf
    if function in _BOUNDED:
        # not 0, the exponent of constants: a bounded value can be 0 and a divisor
        return 1.0
    if function in _AS_LARGE:
        return of[0]
    exponent = graph[node.args[-1]].op
    match function:
        case "sqrt" if sign in _NOT_BELOW:
            return of[0]
        case "log" if sign is Sign.POSITIVE:
            return of[0]
        case "pow" if sign in _NOT_BELOW and isinstance(exponent, ops.Constant):
            if sign is Sign.POSITIVE or min(exponent.values) >= 0.0:
                return of[0] * max(1.0, *exponent.values)
        case _:
            pass
    return math.inf
