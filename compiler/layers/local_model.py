"""`local_model`: one copy of a layer for each cell of a grid of fuzzy sets, weighted by the degrees
of membership.
"""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from compiler.lowering.expressions import lower_all
from spec_schema.errors import shapes
from spec_schema.sections.layers import LocalModel


def local_model(context: LayerContext, settings: LocalModel, arguments: Arguments) -> NodeId:
    """y = Σᵢⱼ… φᵢ · ψⱼ · … · cellᵢⱼ…(x), computed for all cells in one vectorised operation.

    `by` are the degrees of membership φ, ψ, …, each with the axes of its sets. `cell` is any layer
    that has weights, and each of its arrays gets the axes of the sets in front.
    """
    cell = settings.cell.chosen()
    builder = context.builder
    activations, cells = _activations(context, settings)
    result = context.rule_of(cell).expand(context.in_cells(cells), cell, arguments)
    # Innermost first: each contraction removes one axis of the grid.
    for activation in reversed(activations):
        *outer, axis = (a for a in builder.type(activation).axes if a in cells)
        result = builder.contract_over(activation, result, axis.name)
        # an activation along several axes is multiplied along the others first
        for summed in reversed(outer):
            result = builder.sum(result, summed.name)
    return result


def _activations(
    context: LayerContext, settings: LocalModel
) -> tuple[list[NodeId], tuple[Axis, ...]]:
    """The nodes of the degrees of membership φ, ψ, …, and the axes of all their sets. Reports a
    scalar, or an axis that occurs twice, and raises LoweringFailed.
    """
    builder = context.builder
    activations: list[NodeId] = []
    cells: list[Axis] = []
    nodes = lower_all(context.lowering, settings.by, context.environment)
    for index, (expression, node) in enumerate(zip(settings.by, nodes, strict=True)):
        if not context.elements(node):
            wanted = "degrees of membership along one axis or several"
            context.refuse(
                shapes.wrong_axes(
                    "an activation of a local model", wanted, "scalar", expression.span
                )
            )
        if builder.type(node).axis(UNNAMED) is not None:
            node = builder.rename(node, UNNAMED, context.own_axis(f"by{index + 1}", 1).name)
        for axis in context.elements(node):
            if axis in cells:
                what = "the activations of a local model"
                found = f"twice along `{axis.name}`"
                context.refuse(
                    shapes.wrong_axes(what, "along dims of their own", found, expression.span)
                )
            cells.append(axis)
        activations.append(node)
    return activations, tuple(cells)


def _read(context: LayerContext, settings: LocalModel) -> Arguments:
    cell = settings.cell.chosen()
    return context.rule_of(cell).read(context, cell)


LOCAL_MODEL = LayerRule(LocalModel, _read, local_model)
