"""Centres and knots: ascending values along an axis, fixed or learned without crossing."""

from __future__ import annotations

import numpy as np

from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import distance_unit
from compiler.ir.scalars.table import Array
from compiler.ir.types import Axis
from compiler.layers.rules.layer_context import LayerContext
from compiler.lowering.constants import evaluate
from spec_schema.errors import names
from spec_schema.expressions.tree import Expression
from spec_schema.units.unit import Unit


def ascending(context: LayerContext, expression: Expression, layer: str, what: str) -> Array:
    """The values of an option, known at compile time; reports values that do not ascend."""
    values = evaluate(context.lowering, expression).values.ravel()
    if np.any(np.diff(values) <= 0) or not np.all(np.isfinite(values)):
        context.refuse(names.unfit_setting(layer, f"the {what} must ascend", expression.span))
    return values


def learned_centers(context: LayerContext, axis: Axis, values: Array, unit: Unit | None) -> NodeId:
    """c₀ = first, cᵢ₊₁ = cᵢ + gapᵢ with learned gaps > 0, so that the centres stay ordered."""
    builder = context.builder
    first = context.learned("first", (), values[0], "the lowest centre", unit=unit)
    if len(values) == 1:
        return builder.broadcast(first, (axis,))
    between = context.own_axis("gap", len(values) - 1)
    gaps = context.learned(
        "gaps",
        (between,),
        np.diff(values),
        "from one centre to the next",
        unit=distance_unit(unit),
        low=0.0,
    )
    below = np.tri(len(values), len(values) - 1, -1)
    sums = builder.contract_over(builder.constant(below, (axis, between)), gaps, between.name)
    return builder.add(builder.broadcast(first, (axis,)), sums)
