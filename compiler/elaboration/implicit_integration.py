"""Implicit steps of integrators: implicit in all states, or only through one equation, such as
friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from compiler.differentiation.reverse_mode import element_gradients, gradient_nodes
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed
from compiler.ir.ops import Constant
from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.jacobian.zeros import nonzero_elements
from compiler.lowering.context import Context, LoweringFailed, SolvedCall
from compiler.lowering.environment import STEP, Environment
from compiler.lowering.expressions import lower
from spec_schema.errors import states
from spec_schema.expressions.tree import Name
from spec_schema.fields.leaf import Located
from spec_schema.sections.signals import Equation
from spec_schema.units.parser import parse_unit


def felt_state(
    context: Context,
    owner: str,
    of: Located[str],
    values: Mapping[str, NodeId],
    stage: Environment,
    slope: Callable[[str], NodeId],
) -> tuple[str, NodeId]:
    """For the implicit integration of the equation `of`: returns the name of the state whose
    derivative reads the equation, and the node of the equation.

    `values` are the nodes of the states of `owner` at the integrator stage `stage`; `slope(name)`
    returns that of a state's derivative. Exactly one state must both affect the equation and be
    affected by it; otherwise it reports and raises LoweringFailed.
    """
    builder = context.builder(STEP)
    full = f"{owner}.{of.value}" if owner else of.value
    entry = context.names.declared(full, of.span).entry
    if not isinstance(entry, Equation):
        repair = "name the equation of the friction, such as `tau_f`"
        _refuse(context, of, "it is no equation", repair)
    equation = lower(context, Name(full, of.span), stage)
    axes = builder.type(equation).axes
    # both directions: the equation depends on the state, and the derivative on the equation
    found = [
        name
        for name, value in values.items()
        if builder.type(value).axes == axes
        and _depends(builder, equation, value)
        and _depends(builder, slope(name), equation)
    ]
    if len(found) != 1:
        if found:
            problem = f"the derivatives of {' and '.join(f'`{n}`' for n in found)} read it"
        else:
            problem = "no state of its dims is in it and has a derivative that reads it"
        _refuse(context, of, problem, "leave `of` out: then the whole system is implicit")
    return found[0], equation


def _refuse(context: Context, of: Located[str], problem: str, repair: str) -> NoReturn:
    context.findings.report(states.implicit_of_what(of.value, problem, of.span, repair))
    raise LoweringFailed


def _depends(builder: GraphBuilder, value: NodeId, on: NodeId) -> bool:
    """True if the node `value` depends on the node `on`."""
    return needed(builder.graph(), (value,))[on]


_SECOND = parse_unit("s")


@dataclass(frozen=True)
class ImplicitPart:
    """The nodes of a state x (`value`), its derivative f (`slope`), and the equation τ(x) that f
    depends on, which is integrated implicitly.
    """

    builder: GraphBuilder
    value: NodeId
    slope: NodeId
    equation: NodeId

    def increment(self, step: float, solved_calls: Mapping[NodeId, SolvedCall]) -> NodeId:
        """The node of the increment Δ of x in a step of h = `step` seconds: (I − h ∂f/∂τ ∂τ/∂x) Δ =
        h f.

        If f is M⁻¹ (u − b), as the forward dynamics of a robot with torque u, it solves (M − h
        ∂u/∂τ ∂τ/∂x) Δ = h (u − b) instead. `solved_calls` has such f by their nodes.
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
    """The node of the derivatives ∂valueᵢ/∂onᵢ, element by element, with the axes of `on`; other
    elements of the Jacobian are ignored.
    """
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
    """The node of ∂valueᵢ/∂onᵢ, element by element, by one gradient. None if a Jacobian element
    outside the diagonal is not a structural zero, or if `value` does not depend on `on`.
    """
    rows = [row[0] for row in element_gradients(builder, value, [on])]
    nonzero = nonzero_elements(builder.graph(), [row for row in rows if row is not None])
    for index, row in enumerate(rows):
        if row is not None and set(np.flatnonzero(nonzero[row]).tolist()) - {index}:
            return None
    # the gradient of the sum of all elements: for a diagonal Jacobian it is the diagonal
    return gradient_nodes(builder, value, [on])[0]


def _joined(builder: GraphBuilder, numbers: list[NodeId], like: NodeId) -> NodeId:
    """Combines the scalar nodes `numbers`, in C order, to one node with the axes of `like`."""
    parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in numbers]
    joined = builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]
    return builder.reshape(joined, builder.type(like).axes)


Row = dict[int, NodeId]
"""The structurally nonzero elements of a matrix row, by column."""


def increments(
    builder: GraphBuilder, values: Mapping[str, NodeId], slopes: Mapping[str, NodeId], step: float
) -> dict[str, NodeId]:
    """The node of the increment Δ of each state in a step of h = `step` seconds: (I − h J) Δ = h f,
    with the derivatives f (`slopes`) and J = ∂f/∂x at the states x = `values`.

    Gaussian elimination without pivoting. No pivot is near 0 while h J is small compared with I. If
    J is diagonally dominant and stable, all pivots are at least 1 for any h. Structural zeros cost
    nothing.
    """
    # with an unknown unit in the system, the unit of a row of I − h J is unknown
    known = all(builder.type(value).unit is not None for value in values.values())
    h = builder.constant(step, unit=_SECOND if known else None)
    matrix: list[Row] = []
    right: list[NodeId] = []
    for name in values:
        slope = slopes[name]
        matrix += _rows(builder, len(matrix), slope, values, h)
        for index in range(builder.type(slope).size):
            right.append(builder.multiply(h, scalar_of(builder, slope, index)))
    solution = solved(builder, matrix, right)
    found: dict[str, NodeId] = {}
    for name, value in values.items():
        axes = builder.type(value).axes
        size = builder.type(value).size
        parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in solution[:size]]
        joined = builder.concat(parts, UNNAMED) if size > 1 else parts[0]
        found[name] = builder.reshape(joined, axes)
        # unknowns are in the order of `values`: each state takes its elements from the front
        del solution[:size]
    return found


def scalar_of(builder: GraphBuilder, value: NodeId, index: int) -> NodeId:
    """The node of one element of a value; `index` counts in C order."""
    flat = builder.reshape(value, (Axis(UNNAMED, builder.type(value).size),))
    return builder.element(flat, UNNAMED, index)


def _rows(
    builder: GraphBuilder, number: int, slope: NodeId, values: Mapping[str, NodeId], h: NodeId
) -> list[Row]:
    """The rows of I − h J for the elements of the derivative `slope` of one state, with J the
    derivatives by all states `values`. `number` is the index of the first row.
    """
    rows: list[Row] = []
    jacobian = element_gradients(builder, slope, list(values.values()))
    nodes = [gradient for gradients in jacobian for gradient in gradients if gradient is not None]
    nonzero = nonzero_elements(builder.graph(), nodes)
    for gradients in jacobian:
        row: Row = {number + len(rows): builder.constant(1.0)}
        column = 0
        for value, gradient in zip(values.values(), gradients, strict=True):
            if gradient is not None:
                for index in np.flatnonzero(nonzero[gradient]).tolist():
                    scaled = builder.multiply(h, scalar_of(builder, gradient, index))
                    before = row.get(column + index)
                    row[column + index] = difference(builder, before, scaled)
            column += builder.type(value).size
        rows.append(row)
    return rows


def solved(builder: GraphBuilder, matrix: list[Row], right: list[NodeId]) -> list[NodeId]:
    """Solves A x = b by Gaussian elimination without pivoting and back substitution; returns the
    nodes of x. A is `matrix`, a list of rows, b is `right`; both are modified.
    """
    size = len(matrix)
    for k in range(size):
        for i in range(k + 1, size):
            # structurally 0: nothing to eliminate
            if k not in matrix[i]:
                continue
            # no pivoting: the size of elements is unknown at compile time (decision 0241)
            factor = _quotient(builder, matrix[i].pop(k), matrix[k][k])
            for j in [column for column in matrix[k] if column > k]:
                product = builder.multiply(factor, matrix[k][j])
                matrix[i][j] = difference(builder, matrix[i].get(j), product)
            right[i] = builder.subtract(right[i], builder.multiply(factor, right[k]))
    solution: list[NodeId] = list(right)
    for k in reversed(range(size)):
        total = right[k]
        # in the order of columns, which fixes the rounding of the sum
        for j in sorted(column for column in matrix[k] if column > k):
            total = builder.subtract(total, builder.multiply(matrix[k][j], solution[j]))
        solution[k] = _quotient(builder, total, matrix[k][k])
    return solution


def difference(builder: GraphBuilder, left: NodeId | None, right: NodeId) -> NodeId:
    """The node of left − right; None as `left` means a structural zero."""
    return builder.negate(right) if left is None else builder.subtract(left, right)


def _quotient(builder: GraphBuilder, left: NodeId, right: NodeId) -> NodeId:
    # rows that depend on no state have the pivot 1 of I
    return left if builder.node(right).op == Constant((1.0,)) else builder.divide(left, right)
