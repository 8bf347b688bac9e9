"""Takes one step of a state in which only what it feels of one equation is implicit.

`linear_implicit: {of: tau}`: x' = f(x, τ(x)), of which the step solves

    (I − h ∂f/∂τ diag(∂τᵢ/∂xᵢ)) Δ = h f(x, τ(x)).

That is the linearly implicit Euler method with a part of the Jacobian, a W-method of order 1
(Hairer, Wanner: Solving Ordinary Differential Equations II, 1996, IV.7). See decisions/0241.
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
    """A state's value x, its slope f, and the value of the equation τ that f reads."""

    builder: GraphBuilder
    value: NodeId
    slope: NodeId
    equation: NodeId

    def increment(self, step: float, solved_calls: Mapping[NodeId, SolvedCall]) -> NodeId:
        """Δ; where f is M⁻¹ (u − b) as the dynamics of a robot are, from (M − h ∂u/∂τ ∂τ/∂x) Δ."""
        builder = self.builder
        h = builder.constant(step, unit=_SECOND)
        own = _diagonal(builder, self.equation, self.value)
        call = solved_calls.get(self.slope)
        through = None if call is None else _only_diagonal(builder, call.argument, self.equation)
        # M is solved by its structure only where h ∂τ/∂x is a number beside each of its diagonal
        if call is None or through is None:
            return self._eliminated(own, h)
        # M times (I − h M⁻¹ ∂u/∂τ ∂τ/∂x) is M − h ∂u/∂τ ∂τ/∂x: nothing is inverted,
        # and a friction, which u has with a minus, adds to the diagonal
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
    numbers = [
        zero if row is None else scalar_of(builder, row, index) for index, row in enumerate(rows)
    ]
    return _joined(builder, numbers, on)


def _only_diagonal(builder: GraphBuilder, value: NodeId, on: NodeId) -> NodeId | None:
    """The same in one piece; None where an element depends on other ones too."""
    rows = [row[0] for row in element_gradients(builder, value, [on])]
    nonzero = nonzero_elements(builder.graph(), [row for row in rows if row is not None])
    for index, row in enumerate(rows):
        if row is not None and set(np.flatnonzero(nonzero[row]).tolist()) - {index}:
            return None
    # of the sum of all elements: with nothing beside the diagonal it is the diagonal itself
    return gradient_nodes(builder, value, [on])[0]


def _joined(builder: GraphBuilder, numbers: list[NodeId], like: NodeId) -> NodeId:
    """Numbers in C order as a value of the axes of another."""
    parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in numbers]
    joined = builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]
    return builder.reshape(joined, builder.type(like).axes)
