"""Finds whether a value can be NaN or infinite at numbers that a plan may try.

A plan leaves the ranges that a spec declares on its way: of roots, quotients and powers counts what
they are made of, and of products how many factors change with the plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from compiler.ir import ops
from compiler.ir.node_store import NodeStore
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.rules.infinite_values import InfiniteValues, Sign

_BOUNDED = frozenset({"atan", "atan2", "tanh", "sigmoid", "sign"})
_AS_LARGE = frozenset({"abs", "softplus", "sin", "cos"})
"""At most as large; sin and cos are NaN where their argument overflows."""
_NOT_BELOW = (Sign.NOT_NEGATIVE, Sign.POSITIVE)


def can_end(graph: Graph, roots: Iterable[NodeId], most_factors: float) -> bool:
    """Tells if a root is not finite somewhere, where products of `most_factors` numbers are.

    Every value grows at most as a power of what the stage reads: the exponent is counted, ∞ for
    what has no value somewhere or grows faster than any power.
    """
    signs = InfiniteValues(NodeStore(graph))
    factors: list[float] = []
    for _, node in graph:
        # operands stand before their users
        factors.append(_factors(graph, node, [factors[arg] for arg in node.args], signs))
    return any(factors[root] > most_factors for root in roots)


def _factors(graph: Graph, node: Node, of: list[float], signs: InfiniteValues) -> float:
    """The exponent of one value; 0 where it is the same whatever is read."""
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
            # what is cut is within its limits, and NaN where it was
            return max(of) if math.inf in of else max(of[1:])
        case _:
            return max(of, default=0.0)


def _of_function(graph: Graph, node: Node, of: list[float], sign: Sign) -> float:
    """The exponent of a scalar function; `sign` is that of its first argument."""
    assert isinstance(node.op, ops.Apply)
    function = node.op.function
    if math.inf in of:
        return math.inf
    if function in _BOUNDED:
        # not 0: it may be 0 itself, and divide
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
