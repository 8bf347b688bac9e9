"""Reports operands whose axes do not fit, or whose unnamed and named axes form an outer product."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules.alignment import AxisConflict, twin_axes
from compiler.ir.types import describe_axes
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Expression


class aligning:  # noqa: N801  (read as a verb: `with aligning(…):`)
    """Reports an AxisConflict inside the block as a diagnostic about the two operands."""

    def __init__(
        self,
        context: Context,
        operation: str,
        whole: Expression,
        left: Expression,
        right: Expression,
    ) -> None:
        self._facts = context, operation, whole, left, right

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, AxisConflict):
            context, operation, whole, left, right = self._facts
            context.findings.report(
                shapes.axes_differ(
                    operation,
                    describe_axes(error.left),
                    describe_axes(error.right),
                    error.reason,
                    whole.span,
                    left.span,
                    right.span,
                    error.hint or None,
                )
            )
            raise LoweringFailed from error


def warn_of_twin_axes(
    context: Context,
    builder: GraphBuilder,
    operation: str,
    whole: Expression,
    operands: Iterable[tuple[Expression, NodeId]],
) -> None:
    """Warns about the first two operands that form an outer product by accident (`twin_axes`)."""
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
