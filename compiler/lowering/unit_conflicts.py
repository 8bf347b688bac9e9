"""Reports units that do not fit in an expression, at its place and with a repair."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.rules.unit_rules import UnitConflict
from compiler.lowering.context import Context
from spec_schema.diagnostics.source import Span
from spec_schema.errors import units
from spec_schema.expressions.text import number_text
from spec_schema.expressions.tree import Binary, Expression, Number
from spec_schema.units.unit import Unit


def report_unit_conflicts(
    context: Context, builder: GraphBuilder, expression: Expression, operation: str | None = None
) -> None:
    """Reports the unit conflicts that the builder collected for the expression, and clears them.

    `operation` is the user's spelling, if it differs from the name of the node.
    """
    for conflict in builder.conflicts:
        secondary = ()
        if isinstance(expression, Binary):
            secondary = (
                (expression.left.span, f"this is in {conflict.expected.text}"),
                (expression.right.span, f"this is in {conflict.found.text}"),
            )
        context.findings.report(
            units.units_differ(
                operation or conflict.operation,
                conflict.found.text,
                conflict.expected.text,
                expression.span,
                secondary,
                bare=_bare_number(conflict, expression),
                factor=_scale_between(conflict),
            )
        )
    builder.conflicts.clear()


def report_declared_unit(
    context: Context, name: str, found: Unit, declared: Unit, span: Span
) -> None:
    """Reports an expression whose unit differs from the declared one."""
    is_temperature = found.same_dimension(declared) and found.offset != declared.offset
    context.findings.report(
        units.declared_unit_differs(
            name, found.text, declared.text, span, is_temperature=is_temperature
        )
    )


def _bare_number(conflict: UnitConflict, expression: Expression) -> str | None:
    """A number that lacks its unit, written with the unit of the other operand."""
    if not isinstance(expression, Binary):
        return None
    for side, unit in ((expression.left, conflict.found), (expression.right, conflict.expected)):
        if isinstance(side, Number):
            return f"{number_text(side.value)} {unit.text}"
    return None


def _scale_between(conflict: UnitConflict) -> float | None:
    """The factor from the actual to the expected unit, if both have the same dimension."""
    found, expected = conflict.found, conflict.expected
    factor = found.factor_to(expected) if found.same_dimension(expected) else 1.0
    return None if factor == 1.0 else factor
