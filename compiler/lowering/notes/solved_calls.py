"""Remembers calls that solve linear equations: an integrator may solve for more than they do."""

from __future__ import annotations

from collections.abc import Callable

from compiler.ir.program import NodeId
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class SolvedCall:
    """x = M⁻¹ (a − b) in a graph, such as the forward dynamics of a robot: ddq = M⁻¹ (τ − bias).

    `argument` is the node of a. `with_diagonal(d)` is the node of (M + diag(d))⁻¹ (a − b), d along
    the axis of a.
    """

    argument: NodeId
    with_diagonal: Callable[[NodeId], NodeId]
