"""Evaluates constant expressions to arrays at compile time."""

from __future__ import annotations

from typing import TypeGuard

import numpy as np

from compiler.interpreter.constant_value import constant_value
from compiler.ir.scalars.table import Array
from compiler.ir.types import Axis, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.shape_repair import shape_repair
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Expression, LanguageName, ListLiteral, Name
from spec_schema.late_dataclass import dataclass
from spec_schema.units.unit import ONE, Unit

# a graph stores all of its million elements
LARGEST_EYE = 1000


_CONSTANT = Environment(EnvironmentPart.CONSTANT)


@dataclass(frozen=True)
class NamedArray:
    """An array with its axes and unit."""

    values: Array
    axes: tuple[Axis, ...]
    unit: Unit | None


def number(context: Context, expression: Expression, what: str) -> float:
    """Evaluates a constant scalar expression; `what` is its name in messages."""
    array = evaluate(context, expression)
    if array.axes:
        found = describe_axes(array.axes)
        context.findings.report(
            names.unfit_constant(what, f"is {found}, not one number", expression.span)
        )
        raise LoweringFailed
    refuse_infinite(context, what, array.values, expression.span)
    return float(array.values)


def whole_number(context: Context, expression: Expression, what: str) -> int:
    """Evaluates a constant scalar expression that must be an integer."""
    value = number(context, expression, what)
    if not value.is_integer():
        context.findings.report(names.unfit_constant(what, "is no whole number", expression.span))
        raise LoweringFailed
    return int(value)


def evaluate(
    context: Context, expression: Expression, environment: Environment = _CONSTANT
) -> NamedArray:
    """Evaluates an expression of constants and of the values that `environment` adds, such as
    indices.
    """
    # the rows of a matrix have no axis name until `dims:` gives it: a node cannot represent them
    if isinstance(expression, ListLiteral) and any(
        isinstance(element, ListLiteral) for element in expression.elements
    ):
        return _matrix(context, expression)
    if _is_eye(expression, context):
        return _eye(context, expression)
    node = lower(context, expression, environment)
    builder = context.builder(environment)
    type = builder.type(node)
    return NamedArray(constant_value(builder.graph(), node), type.axes, type.unit)


def _is_eye(expression: Expression, context: Context) -> TypeGuard[Call]:
    """True for `eye` of a number. With two names, `eye` is a matrix of these dims instead."""
    return (
        isinstance(expression, Call)
        and isinstance(expression.function, Name)
        and expression.function.name == "eye"
        and (isinstance(expression.function, LanguageName) or "eye" not in context.scope)
        and len(expression.arguments) == 1
    )


def _eye(context: Context, call: Call) -> NamedArray:
    """Evaluates `eye(3)`. As in any matrix, `dims:` names its axes."""
    (argument,) = call.arguments
    size = number(context, argument, "the size of `eye`")
    if not (size.is_integer() and 1 <= size <= LARGEST_EYE):
        problem = f"is no whole number from 1 to {LARGEST_EYE}"
        report = names.unfit_constant("the size of `eye`", problem, argument.span)
        context.findings.report(report)
        raise LoweringFailed
    # the same axis twice is illegal in a node: `shaped` replaces both by those of `dims:`
    axis = Axis("", int(size))
    return NamedArray(np.eye(axis.size), (axis, axis), ONE)


def _matrix(context: Context, rows: ListLiteral) -> NamedArray:
    parts = [evaluate(context, row).values for row in rows.elements]
    if len({part.shape for part in parts}) > 1:
        context.findings.report(
            names.unfit_constant("this list", "has rows of different lengths", rows.span)
        )
        raise LoweringFailed
    # Axes get their names from `dims:`; until then only the sizes matter.
    values = np.array(parts)
    return NamedArray(values, tuple(Axis("", size) for size in values.shape), ONE)


def shaped(context: Context, name: str, values: Array, axes: tuple[Axis, ...], span: Span) -> Array:
    """Gives the values the shape of the axes.

    A scalar is repeated; any other shape must be equal.
    """
    shape = tuple(axis.size for axis in axes)
    if values.shape not in ((), shape):
        problem = f"has the shape {list(values.shape)}, not {describe_axes(axes)}"
        repair = shape_repair(context, name, values.shape, axes)
        context.findings.report(names.unfit_constant(f"`{name}`", problem, span, repair))
        raise LoweringFailed
    refuse_infinite(context, f"`{name}`", values, span)
    # read-only; a scalar is repeated without a copy
    return np.broadcast_to(values, shape)


def refuse_infinite(context: Context, what: str, values: Array | float, span: Span) -> None:
    """Reports values that are infinite or NaN: a program has no such constants."""
    if not np.all(np.isfinite(values)):
        context.findings.report(names.unfit_constant(what, "is not finite", span))
        raise LoweringFailed
