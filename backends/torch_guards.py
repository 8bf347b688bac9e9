"""Keeps the branch that a `Select` does not take from spoiling gradients with 0 · ∞ = NaN."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from compiler.ops import Apply, Contract, Divide, Multiply, Select
from compiler.program import Graph, NodeId

_SINGULAR = frozenset({"sqrt", "log", "pow", "asin", "acos", "atan2", "tan", "exp", "sinh", "cosh"})
"""Functions whose value or slope can be infinite at a finite argument."""


class _NoUndefinedSlope(torch.autograd.Function):
    """The identity, whose slope turns NaN into 0."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        return value.view_as(value)

    @staticmethod
    def backward(ctx: Any, *slopes: Any) -> Any:
        (slope,) = slopes
        return torch.where(torch.isnan(slope), torch.zeros_like(slope), slope)


class UntakenBranch(nn.Module):
    """Passes a value on; the undefined slope that an untaken branch sends back becomes 0.

    In `where(x > 0, sqrt(x), 0)` the slope of sqrt at x ≤ 0 is NaN or ∞ and is multiplied by 0. A
    NaN that matters is seen in the value of the loss, which is checked before any slope is used.
    """

    def forward(self, value: Tensor) -> Tensor:
        return _NoUndefinedSlope.apply(value)  # pyright: ignore[reportReturnType]


def guarded_nodes(graph: Graph) -> frozenset[NodeId]:
    """Nodes under a branch of a `Select` whose operands need `UntakenBranch`.

    These are divisions and singular functions, and the products that use their values: with ∞ as
    one factor the slope of the other is 0 · ∞.
    """
    under = _under_a_branch(graph)
    unbounded: set[NodeId] = set()
    guarded: set[NodeId] = set()
    for index, node in graph:
        if not under[index]:
            continue
        singular = isinstance(node.op, Divide) or (
            isinstance(node.op, Apply) and node.op.function in _SINGULAR
        )
        fed = any(arg in unbounded for arg in node.args)
        if singular or fed:
            unbounded.add(index)
        if singular or (fed and isinstance(node.op, Multiply | Contract | Apply)):
            guarded.add(index)
    return frozenset(guarded)


def _under_a_branch(graph: Graph) -> list[bool]:
    under = [False] * len(graph)
    for index in reversed(range(len(graph))):
        node = graph[index]
        if isinstance(node.op, Select):
            for arg in node.args[1:]:
                under[arg] = True
        if under[index]:
            for arg in node.args:
                under[arg] = True
    return under
