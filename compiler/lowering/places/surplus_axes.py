"""Reports a value with too many axes, at the operand that adds them."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.ir.program import NodeId
from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from compiler.ir.types import UNNAMED, Axis, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import lower
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Binary, Call, Compare, Expression, Name, Negate, Operator

# the axes of their results are those of their operands, so one operand is at fault
_ELEMENTWISE = frozenset(
    {*SCALAR_FUNCTIONS, "min", "max", "clip", "where", "relu", "elu", "sech", "smooth_sign"}
)


def report_surplus(
    context: Context,
    what: str,
    node: NodeId,
    wanted: Sequence[Axis],
    expression: Expression,
    environment: Environment,
) -> None:
    """Reports that an expression has axes other than `wanted`; `node` is its value.

    The reported operand of `bias + sum(q) + q` is the last term. The search descends into operands
    as long as exactly one of them adds such an axis.
    """
    builder = context.builder(environment)
    found = describe_axes(builder.type(node).axes)
    place, operand = expression, found
    while True:
        bringing = [
            (one, axes)
            for one in _operands(context, place)
            if not set(axes := _axes(context, one, environment)) <= set(wanted)
        ]
        if len(bringing) != 1:
            break
        place, operand = bringing[0][0], describe_axes(bringing[0][1])
    repair = _repair(builder.type(node).axes, wanted)
    context.findings.report(
        shapes.wrong_axes(
            what, describe_axes(tuple(wanted)), found, place.span, repair, operand=operand
        )
    )


def _repair(axes: Sequence[Axis], wanted: Sequence[Axis]) -> str | None:
    """The repair if a list lacks only the name of its dimension."""
    if len(axes) == len(wanted) == 1 and axes[0] == Axis(UNNAMED, wanted[0].size):
        return f"a list has no dim: declare it as a constant with `dims: {wanted[0].name}`"
    return None


def _operands(context: Context, expression: Expression) -> tuple[Expression, ...]:
    """The operands of an elementwise operation; empty for other operations."""
    match expression:
        case Negate(operand=operand):
            return (operand,)
        case Binary(operator=operator, left=left, right=right):
            return () if operator is Operator.CONTRACT else (left, right)
        case Compare(left=left, right=right):
            return left, right
        case Call(function=Name(name=name), arguments=arguments):
            return arguments if name in _ELEMENTWISE and name not in context.scope else ()
        case _:
            return ()


def _axes(context: Context, operand: Expression, environment: Environment) -> tuple[Axis, ...]:
    node = context.names.tried(lambda: lower(context, operand, environment))
    return () if node is None else context.builder(environment).type(node).axes
