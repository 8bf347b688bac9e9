"""Remembers where forward dynamics are computed: an integrator may solve for more than they do."""

from __future__ import annotations

from collections.abc import Callable

from compiler.ir.program import NodeId
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class DynamicsCall:
    """ddq = M⁻¹ (τ − bias) in a graph: the node of τ, and how to solve with another matrix.

    `with_diagonal(d)` is the node of (M + diag(d))⁻¹ (τ − bias), d along the joints.
    """

    torque: NodeId
    with_diagonal: Callable[[NodeId], NodeId]
