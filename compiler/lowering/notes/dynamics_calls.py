"""Records calls of forward dynamics, so that an implicit integrator can solve with more terms."""

from __future__ import annotations

from collections.abc import Callable

from compiler.ir.program import NodeId
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class DynamicsCall:
    """ddq = M⁻¹ (τ − bias) in a graph: the node of τ, and a way to change M.

    `with_diagonal(d)` returns the node of (M + diag(d))⁻¹ (τ − bias), d along the joints.
    """

    torque: NodeId
    with_diagonal: Callable[[NodeId], NodeId]
