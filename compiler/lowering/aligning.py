"""Tells users of operands whose axes cannot meet."""

from __future__ import annotations

from compiler.ir.rules.alignment import AxisConflict
from compiler.ir.types import describe_axes
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Expression


class aligning:  # noqa: N801  (read as a verb: `with aligning(…):`)
    """Turns an AxisConflict inside the block into a diagnostic about two operands."""

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
