"""`fuzzify`: the degree of membership of a scalar in each of several fuzzy sets, or in a grid of
them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from compiler.ir.program import NodeId
from compiler.ir.rules import distance_unit
from compiler.ir.scalars import Array
from compiler.ir.types import UNNAMED, Axis
from compiler.layers.rules.arguments import read_scalars
from compiler.layers.rules.fuzzy_sets import (
    FuzzySets,
    ascending,
    gaussian,
    learned_centers,
    neighbour_widths,
    rectangular,
    triangular,
)
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.errors import names, shapes
from spec_schema.expressions.tree import Member
from spec_schema.sections.layers import CustomMembership, Fuzzify, Layer
from spec_schema.units.unit import Unit


def fuzzify(context: LayerContext, settings: Fuzzify, arguments: Arguments) -> NodeId:
    """μ[i] of a scalar x: its degree of membership in the fuzzy set around each of the ascending
    `centers` cᵢ.

    `membership: triangular` are hat functions that sum to 1, constantly 1 beyond the ends.
    `rectangular` is 1 between the bounds half-way to the neighbours, the lower one inclusive.
    `gaussian` is exp(−((x − cᵢ) / wᵢ)² / 2), with wᵢ half the mean distance to the neighbours.
    `{function: f}` is f(x − cᵢ) of a function of the spec. With `learn: true` the centres are
    learned and stay in order, as arrays `first` and `gaps`; `widths` are those of gaussian sets.

    `over: [phi, psi]` with `combine: product` makes a grid of other fuzzify layers, called with one
    value for each of them: φᵢ(x) · ψⱼ(y), with the axes of both.

    `NAME.centers` are the centres cᵢ as a value, along `dim`, in the unit of the layer's argument;
    `NAME.offset(x)` is x − cᵢ, with the window of x. A grid has neither.
    """
    if settings.over:
        return _grid(context, settings, arguments)
    (value,) = arguments
    sets = _sets(context, settings, value)
    builder, axis = context.builder, sets.axis
    match settings.membership:
        case "triangular":
            return triangular(sets)
        case "rectangular":
            return rectangular(sets)
        case "gaussian":
            # half the mean distance to the neighbours; learned widths begin there
            widths = neighbour_widths(_numbers(context, settings))
            unit = distance_unit(builder.type(value).unit)
            if settings.learn:
                doc = "width of each set"
                width = context.learned("widths", (axis,), widths, doc, unit=unit, low=0.0)
            else:
                width = builder.constant(widths, (axis,), unit)
            return gaussian(sets, width)
        case CustomMembership(function=function):
            return context.apply(function, [sets.distances()])
        case _:
            assert_never(settings.membership)


def _offset(context: LayerContext, settings: Fuzzify, arguments: Arguments) -> NodeId:
    (value,) = arguments
    return _sets(context, settings, value).distances()


def _centers(context: LayerContext, settings: Fuzzify) -> NodeId:
    """The node of `NAME.centers`, in the unit with which the layer is called anywhere in
    the spec.
    """
    _refuse_grid(context, settings)
    stores, name = context.stores, context.name
    stores.read_uncalled.add(name)
    # what the lowering before this one found, else what this one has found so far
    unit = stores.known_units.get(name) or stores.argument_units.get(name)
    return _along_the_sets(context, settings, unit)[1]


def _sets(context: LayerContext, settings: Fuzzify, value: NodeId) -> FuzzySets:
    """The argument `value` of the layer together with the centres, which have its unit."""
    unit = context.builder.type(value).unit
    if unit is not None:
        # the unit of the first call, which `NAME.centers` has wherever it stands
        context.stores.argument_units.setdefault(context.name, unit)
    return FuzzySets(context.builder, value, *_along_the_sets(context, settings, unit))


def _along_the_sets(
    context: LayerContext, settings: Fuzzify, unit: Unit | None
) -> tuple[Axis, NodeId]:
    """The axis of the fuzzy sets, and the node of their centres along it, constant or learned, in
    `unit`. Reports settings that do not fit and raises LoweringFailed.
    """
    centers = _numbers(context, settings)
    axis = Axis(UNNAMED, len(centers))
    if settings.dim is not None:
        axis = context.axis(settings.dim)
        if axis.size != len(centers):
            assert settings.centers is not None
            wanted, found = f"{axis.size} centres", f"{len(centers)} centres"
            place = settings.centers.span
            context.refuse(shapes.wrong_axes(f"`{axis.name}`", wanted, found, place))
    # their slope is 0 wherever there is one
    if settings.learn and settings.membership == "rectangular":
        problem = "rectangular sets have no slope that their centres could be learned from"
        context.refuse(names.unfit_setting("fuzzify", problem, settings.place.key))
    if settings.learn:
        return axis, learned_centers(context, axis, centers, unit)
    return axis, context.builder.constant(centers, (axis,), unit)


def _numbers(context: LayerContext, settings: Fuzzify) -> Array:
    """The centres as the spec declares them, an ascending array; otherwise reports them and raises
    LoweringFailed.
    """
    assert settings.centers is not None
    return ascending(context, settings.centers, "fuzzify", "centres")


def _refuse_grid(context: LayerContext, settings: Fuzzify) -> None:
    member = context.call.function
    if settings.over and isinstance(member, Member):
        inner = [reference.value for reference in settings.over]
        context.refuse(names.member_of_grid(context.name, member.name, inner, member.span))


def _grid(context: LayerContext, settings: Fuzzify, arguments: Arguments) -> NodeId:
    builder = context.builder
    result: NodeId | None = None
    for reference, argument in zip(settings.over, arguments, strict=True):
        entry = context.lowering.names.declared(reference.value, reference.span).entry
        inner = entry.chosen() if isinstance(entry, Layer) else None
        if not isinstance(inner, Fuzzify) or inner.over:
            problem = f"`{reference.value}` is not a fuzzify layer with centers"
            context.refuse(names.unfit_setting("fuzzify", problem, reference.span))
        # the grid reads the arrays of the other layer: under its name, not under the grid's
        own = replace(context, name=reference.value, span=entry.place.key)
        degrees = fuzzify(own, inner, (argument,))
        taken = [axis.name for axis in context.elements(result)] if result is not None else []
        # two layers along one dimension would multiply element by element instead of making a grid
        if inner.dim is None or inner.dim.value in taken:
            problem = f"`{reference.value}` needs a `dim:` of its own in a grid"
            context.refuse(names.unfit_setting("fuzzify", problem, reference.span))
        result = degrees if result is None else builder.multiply(result, degrees)
    assert result is not None
    return result


def _read(context: LayerContext, settings: Fuzzify) -> Arguments:
    _refuse_grid(context, settings)
    return read_scalars(context, len(settings.over) or 1)


FUZZIFY = LayerRule(
    Fuzzify, _read, fuzzify, members={"offset": _offset}, values={"centers": _centers}
)
