"""Evaluates constant expressions to arrays, and converts declared ranges and limits to the unit of
their values.
"""

from __future__ import annotations

import math
from typing import TypeGuard

import numpy as np

from compiler.interpreter.operations import constant_value
from compiler.ir.program import Expected
from compiler.ir.scalars import Array
from compiler.ir.types import Axis, describe_axes
from compiler.linking.link import Connected
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import STEP, Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, schema
from spec_schema.expressions.tree import Call, Expression, LanguageName, ListLiteral, Name
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.signals import Equation
from spec_schema.sections.values import Dimension
from spec_schema.units.quantity import Quantity, Range, converted
from spec_schema.units.unit import ONE, Unit

# a graph stores all of its million elements
LARGEST_EYE = 1000


_CONSTANT = Environment(EnvironmentPart.CONSTANT)


@dataclass(frozen=True)
class NamedArray:
    """The values of a constant expression, with axes and unit."""

    values: Array
    axes: tuple[Axis, ...]
    unit: Unit | None


def number(context: Context, expression: Expression, what: str) -> float:
    """Evaluates a constant scalar expression; `what` names it in messages. Reports a value that is
    no finite scalar and raises LoweringFailed.
    """
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
    """Evaluates a constant scalar expression that must be an integer; `what` names it in messages.
    Reports any other value and raises LoweringFailed.
    """
    value = number(context, expression, what)
    if not value.is_integer():
        context.findings.report(names.unfit_constant(what, "is no whole number", expression.span))
        raise LoweringFailed
    return int(value)


def evaluate(
    context: Context, expression: Expression, environment: Environment = _CONSTANT
) -> NamedArray:
    """Evaluates an expression of constants, and of names that `environment` adds, such as indices.
    Raises LoweringFailed after a report.
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
    """True for a call `eye(n)` with one argument, the identity matrix of size n. `eye(a, b)` of two
    dimensions is an ordinary builtin.
    """
    return (
        isinstance(expression, Call)
        and isinstance(expression.function, Name)
        and expression.function.name == "eye"
        and (isinstance(expression.function, LanguageName) or "eye" not in context.scope)
        and len(expression.arguments) == 1
    )


def _eye(context: Context, call: Call) -> NamedArray:
    """The identity matrix of `eye(n)`, with two unnamed axes, since `dims:` names the axes of a
    matrix. Reports a size that is no integer within the limits and raises LoweringFailed.
    """
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
    """The values of the array `name` in the shape of `axes`, read-only.

    A scalar is repeated. Reports any other wrong shape or an infinite value, and raises
    LoweringFailed.
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
    """Reports values that are infinite or NaN and raises LoweringFailed: programs have no such
    constants. `what` names the values in the message.
    """
    if not np.all(np.isfinite(values)):
        context.findings.report(names.unfit_constant(what, "is not finite", span))
        raise LoweringFailed


def shape_repair(
    context: Context, name: str, found: tuple[int, ...], axes: tuple[Axis, ...]
) -> str | None:
    """The suggested repair for values of the shape `found`, if the entry `name` declares other
    axes; None if there is no simple one.
    """
    if axes:
        wanted = " x ".join(str(axis.size) for axis in axes)
        return f"write {wanted} numbers, or one number for all"
    if set(found) == {1}:
        return "write the number without brackets"
    # arrays of a layer have no entry to which `dims:` could be added
    return dims_repair(context, found) if name in context.scope else None


def dims_repair(context: Context, shape: tuple[int, ...]) -> str:
    """A repair as text: the `dims:` that an array of this shape needs, with the declaration of
    missing dimensions.
    """
    declared = {
        entry.name: entry.entry.size
        for entry in context.scope.values()
        if isinstance(entry.entry, Dimension)
    }
    taken: list[str] = []
    missing: list[str] = []
    for position, size in enumerate(shape, start=1):
        # the axes of one array have different names
        fitting = (name for name in declared if declared[name] == size and name not in taken)
        name = next(fitting, None)
        if name is None:
            name = "NAME" if len(shape) == 1 else f"NAME{position}"
            missing.append(f"{name}: {size}")
        taken.append(name)
    names = taken[0] if len(taken) == 1 else f"[{', '.join(taken)}]"
    repair = f"add `dims: {names}` to it"
    return f"{repair}, and `{', '.join(missing)}` to `dims:` of the spec" if missing else repair


def range_in(
    context: Context, range: Range | None, unit: Unit | None
) -> tuple[float, float] | None:
    """A declared range (low, high), converted to the unit of the value; a bare number is already in
    it. None without a range.

    Raises LoweringFailed after reporting a unit of another dimension or an empty or infinitely wide
    range.
    """
    if range is None:
        return None
    low, high = (limit_in(context, limit, unit) for limit in (range.low, range.high))
    if low >= high:
        context.findings.report(schema.reversed_range(range.low.text, range.high.text, range.span))
        raise LoweringFailed
    # checks, tests and controllers draw samples from the whole range and need its width
    if not math.isfinite(high - low):
        text, wanted = f"{range.low.text} … {range.high.text}", "a range whose width is a number"
        context.findings.report(schema.out_of_range(text, range.span, wanted))
        raise LoweringFailed
    return low, high


def limit_in(context: Context, limit: Quantity, unit: Unit | None) -> float:
    """A limit, converted to the unit of the limited value. Raises LoweringFailed after reporting a
    unit of another dimension.
    """
    number = converted(limit, unit, context.findings)
    if number is None:
        raise LoweringFailed
    return number


def width_in(context: Context, width: Quantity, unit: Unit | None) -> float:
    """`width`, a difference of two values such as a standard deviation, converted to their unit
    without the offset of units such as degC. Raises LoweringFailed after reporting a unit of
    another dimension.
    """
    number = converted(width, unit, context.findings, is_distance=True)
    if number is None:
        raise LoweringFailed
    return number


def signal_ranges(context: Context) -> dict[str, tuple[float, float]]:
    """The ranges (low, high) of all inputs, targets and states that have one, by name. Invalid
    ranges are reported and omitted.
    """
    ranges: dict[str, tuple[float, float]] = {}
    for entries in (context.spec.inputs, context.spec.targets, context.spec.states):
        for name, entry in entries.items():
            unit = entry.unit.value if entry.unit else None
            try:
                limits = range_in(context, entry.range, unit)
            except LoweringFailed:
                continue
            if limits is not None:
                ranges[name] = limits
    return ranges


def expected_values(context: Context) -> list[Expected]:
    """The expected ranges of equations, and of connected inputs whose declaration has a range, for
    each node that computes such a value. Invalid ranges are reported and omitted.
    """
    builder = context.builder(STEP)
    expected: list[Expected] = []
    for name, entry in context.spec.equations.items():
        declared = _range_of(entry)
        # a node that several times share counts once
        nodes = list(dict.fromkeys(node for _, node in context.names.lowerings(name, STEP)))
        if declared is None or not nodes:
            continue
        try:
            # an equation without declared unit has the unit of its formula
            limits = range_in(context, declared, builder.type(nodes[0]).unit)
        except LoweringFailed:
            continue
        assert limits is not None
        expected += [Expected(name, node, limits, entry.place.key) for node in nodes]
    return expected


def _range_of(entry: Equation) -> Range | None:
    if isinstance(entry, Connected):
        return entry.feeds.range
    return entry.range
