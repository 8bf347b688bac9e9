"""Warns where a named and an unnamed axis of one length make all pairs of their elements."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules.alignment import AxisConflict, twin_axes
from compiler.ir.types import describe_axes
from compiler.lowering.context import Context
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Expression


def warn_of_twin_axes(
    context: Context,
    builder: GraphBuilder,
    operation: str,
    whole: Expression,
    operands: Iterable[tuple[Expression, NodeId]],
) -> None:
    """Says so of the first two operands of an elementwise operation that do; once is enough."""
    typed = [(operand.span, builder.type(node).axes) for operand, node in operands]
    for (left, left_axes), (right, right_axes) in combinations(typed, 2):
        try:
            found = twin_axes(left_axes, right_axes)
        except AxisConflict:
            return  # which the operation itself reports
        if found is not None:
            sides = (left, describe_axes(left_axes)), (right, describe_axes(right_axes))
            context.findings.report(
                shapes.twin_axes(operation, found.name, found.size, whole.span, *sides)
            )
            return
