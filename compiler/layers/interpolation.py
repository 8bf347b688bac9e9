"""`interpolation`: a table of values at knots, linear between them, fixed or learned."""

from __future__ import annotations

import numpy as np

from compiler.ir.program import NodeId
from compiler.ir.scalars import Array
from compiler.layers.rules.arguments import read_scalars
from compiler.layers.rules.fuzzy_sets import FuzzySets, ascending, beyond, triangular
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from compiler.lowering.constants import evaluate
from spec_schema.errors import names, shapes
from spec_schema.expressions.tree import Expression
from spec_schema.sections.layer_kinds import Interpolation
from spec_schema.units.unit import ONE, Unit


def interpolation(context: LayerContext, settings: Interpolation, arguments: Arguments) -> NodeId:
    """y = Σᵢ μᵢ(x) · Yᵢ, or in two dimensions Σᵢⱼ μᵢ(x) · νⱼ(x₂) · Yᵢⱼ: (bi)linear interpolation of
    the table Y.

    μ and ν are hat functions on the ascending knots `x` and `x2`; in two dimensions `y` has one row
    for each knot of `x`. Outside the knots `outside: clamp` keeps the value at the end,
    `extrapolate` continues the last line. The derivative at a knot is the right-hand one. With
    `learn: true` the values are learned, as array `y`; `unit` is their unit. Knots are in the
    argument's unit.
    """
    builder = context.builder
    knots = [_knots(context, settings.x)]
    if settings.x2 is not None:
        knots.append(_knots(context, settings.x2))
    axes = tuple(
        context.own_axis(f"knot{number}", len(values)) for number, values in enumerate(knots, 1)
    )
    table = evaluate(context.lowering, settings.y)
    shape = tuple(len(values) for values in knots)
    if table.values.shape != shape:
        what, place = f"`y` of `{context.name}`", settings.y.span
        found, wanted = _counted(table.values.shape), _counted(shape)
        context.refuse(shapes.wrong_axes(what, wanted, found, place))
    if not np.all(np.isfinite(table.values)):
        context.refuse(names.unfit_setting("interpolation", "`y` is not finite", settings.y.span))
    unit = _unit(settings, table.unit)
    # a cell of a local model has values of its own, learned whether the table says so or not
    if settings.learn or context.cells:
        doc = "values on the knots"
        result = context.learned("y", axes, table.values, doc, unit=unit)
    else:
        result = builder.constant(table.values, axes, unit)
    # Last axis first: neighbours in memory are added first.
    for value, axis, points in reversed(list(zip(arguments, axes, knots, strict=True))):
        centers = builder.constant(points, (axis,), builder.type(value).unit)
        sets = FuzzySets(builder, value, axis, centers)
        degrees = triangular(sets)
        if settings.outside == "extrapolate":
            degrees = builder.add(degrees, beyond(sets))
        result = builder.contract_over(degrees, result, axis.name)
    return result


def _counted(shape: tuple[int, ...]) -> str:
    """The shape of a table as text for messages: `3 values`, `2 rows of 3 values`."""
    values = f"{shape[-1]} value{'s' if shape[-1] != 1 else ''}" if shape else "one number"
    rows = f"{shape[0]} row{'s' if shape[0] != 1 else ''} of " if len(shape) == 2 else ""
    return rows + values


def _knots(context: LayerContext, expression: Expression) -> Array:
    values = ascending(context, expression, "interpolation", "knots")
    if len(values) < 2:
        problem = "a table needs two knots or more"
        context.refuse(names.unfit_setting("interpolation", problem, expression.span))
    return values


def _unit(settings: Interpolation, own: Unit | None) -> Unit | None:
    """The unit of the table: the declared one, else `own`, that of a named constant. None (unknown)
    for plain numbers.
    """
    if settings.unit is not None:
        return settings.unit.value
    return own if own is not None and not own.same_as(ONE) else None


def _read(context: LayerContext, settings: Interpolation) -> Arguments:
    return read_scalars(context, 1 if settings.x2 is None else 2)


INTERPOLATION = LayerRule(Interpolation, _read, interpolation)
