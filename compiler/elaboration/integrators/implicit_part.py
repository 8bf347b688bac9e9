"""Takes one integrator step of a state, implicit only in its dependence on one equation.

`linear_implicit: {of: tau}`: x' = f(x, τ(x)), of which the step solves

    (I − h ∂f/∂τ diag(∂τᵢ/∂xᵢ)) Δ = h f(x, τ(x)).

That is the linearly implicit Euler method with a part of the Jacobian, a W-method of order 1
(Hairer, Wanner: Solving Ordinary Differential Equations II, 1996, IV.7). See decision 0241.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.differentiation.gradient_nodes import element_gradients, gradient_nodes
from compiler.elaboration.integrators.linear_implicit import Row, difference, scalar_of, solved
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.jacobian.sparsity_pattern import nonzero_elements
from compiler.lowering.notes.solved_calls import SolvedCall
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")


@dataclass(frozen=True)
class ImplicitPart:
    """A state x, its derivative f (`slope`), and the equation τ that f depends on."""

    builder: GraphBuilder
    value: NodeId
    slope: NodeId
    equation: NodeId

    def increment(self, step: float, solved_calls: Mapping[NodeId, SolvedCall]) -> NodeId:
        """Returns Δ for a step of `step` seconds.

        If f is M⁻¹ (u − b), as the forward dynamics of a robot with torque τ, it solves
        (M − h ∂u/∂τ ∂τ/∂x) Δ instead.
        """
        builder = self.builder
        h = builder.constant(step, unit=_SECOND)
        own = _diagonal(builder, self.equation, self.value)
        call = solved_calls.get(self.slope)
        through = None if call is None else _only_diagonal(builder, call.argument, self.equation)
        # the structured solver of M can only add a term to each diagonal element
        if call is None or through is None:
            return self._eliminated(own, h)
        # M times (I − h M⁻¹ ∂u/∂τ ∂τ/∂x), u the torque, is M − h ∂u/∂τ ∂τ/∂x: no inverse is
        # needed, and friction, which u contains with a minus, adds to the diagonal
        added = builder.multiply(h, builder.multiply(builder.negate(through), own))
        return builder.multiply(h, call.with_diagonal(added))

    def _eliminated(self, own: NodeId, h: NodeId) -> NodeId:
        builder = self.builder
        rows: list[Row] = []
        right: list[NodeId] = []
        found = [row[0] for row in element_gradients(builder, self.slope, [self.equation])]
        present = [gradient for gradient in found if gradient is not None]
        nonzero = nonzero_elements(builder.graph(), present)
        for index, gradient in enumerate(found):
            # row i of I − h ∂f/∂τ · ∂τ/∂x, ∂τ/∂x a diagonal
            row: Row = {index: builder.constant(1.0)}
            if gradient is not None:
                for column in np.flatnonzero(nonzero[gradient]).tolist():
                    slope = scalar_of(builder, gradient, column)
                    change = builder.multiply(slope, scalar_of(builder, own, column))
                    scaled = builder.multiply(h, change)
                    row[column] = difference(builder, row.get(column), scaled)
            rows.append(row)
            right.append(builder.multiply(h, scalar_of(builder, self.slope, index)))
        return _joined(builder, solved(builder, rows, right), self.value)


def _diagonal(builder: GraphBuilder, value: NodeId, on: NodeId) -> NodeId:
    """∂valueᵢ/∂onᵢ, with the axes of both."""
    whole = _only_diagonal(builder, value, on)
    if whole is not None:
        return whole
    rows = [row[0] for row in element_gradients(builder, value, [on])]
    zero = builder.constant(0.0)
    elements = [
        zero if row is None else scalar_of(builder, row, index) for index, row in enumerate(rows)
    ]
    return _joined(builder, elements, on)


def _only_diagonal(builder: GraphBuilder, value: NodeId, on: NodeId) -> NodeId | None:
    """The same, computed as one gradient; None if the Jacobian has elements off the diagonal."""
    rows = [row[0] for row in element_gradients(builder, value, [on])]
    nonzero = nonzero_elements(builder.graph(), [row for row in rows if row is not None])
    for index, row in enumerate(rows):
        if row is not None and set(np.flatnonzero(nonzero[row]).tolist()) - {index}:
            return None
    # the gradient of the sum of all elements: for a diagonal Jacobian it is the diagonal
    return gradient_nodes(builder, value, [on])[0]


def _joined(builder: GraphBuilder, numbers: list[NodeId], like: NodeId) -> NodeId:
    """Combines scalars, in C order, to a value with the axes of `like`."""
    parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in numbers]
    joined = builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]
    return builder.reshape(joined, builder.type(like).axes)
