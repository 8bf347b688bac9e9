"""Reads the arguments of layer calls: values, time windows, and arrays that are named
parameters.
"""

from __future__ import annotations

import math
from typing import Protocol

from compiler.ir.ops import Reshape
from compiler.ir.program import NodeId
from compiler.ir.rules import same_unit
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type, describe_axes
from compiler.layers.rules.layer_rule import Arguments, LayerContext
from compiler.lowering.expressions import lower, lower_all, window_of
from spec_schema.errors import names, shapes, time
from spec_schema.expressions.tree import Future, Length, Past, Window
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.sections.values import Parameter


class Windowed(Protocol):
    """Settings of a layer that runs over a window; `window` is None if the argument itself must
    have one.
    """

    @property
    def window(self) -> Length | None: ...


def read_values(context: LayerContext, count: int) -> Arguments:
    """The nodes of a layer call's arguments. Reports an error unless there are exactly `count`, and
    no keywords, and raises LoweringFailed.
    """
    wanted = f"{count} argument{'s' if count > 1 else ''}"
    _check_count(context, wanted, len(context.call.arguments) == count)
    return tuple(lower_all(context.lowering, context.call.arguments, context.environment))


def read_value(context: LayerContext, settings: Entry) -> Arguments:
    """The node of a layer call's only argument, of any shape, in a tuple; `settings` have no
    effect. Raises LoweringFailed after reporting another number of arguments.
    """
    del settings
    return read_values(context, 1)


def read_scalars(context: LayerContext, count: int) -> Arguments:
    """The nodes of exactly `count` arguments, which may have a window but no other axes. Otherwise
    reports the mistake and raises LoweringFailed.
    """
    nodes = read_values(context, count)
    for node, argument in zip(nodes, context.call.arguments, strict=True):
        others = context.elements(node)
        if others:
            context.refuse(
                shapes.wrong_axes(
                    f"the argument of `{context.name}`",
                    "a scalar",
                    describe_axes(others),
                    argument.span,
                )
            )
    return nodes


def read_elements(context: LayerContext, settings: Entry) -> Arguments:
    """One node with at least one axis besides the window: the only argument, or the elements of all
    arguments concatenated. A scalar becomes one element.

    `settings` have no effect. Reports windows of different lengths or a call without arguments, and
    raises LoweringFailed.
    """
    del settings
    _check_count(context, "1 or more arguments", bool(context.call.arguments))
    nodes = lower_all(context.lowering, context.call.arguments, context.environment)
    builder = context.builder
    if len(nodes) == 1 and context.elements(nodes[0]):
        return tuple(nodes)
    # a common window stays the last axis; values without a window are repeated along it
    windows = {builder.type(node).window for node in nodes} - {None}
    if len(windows) > 1:
        found = " and ".join(f"{window} samples" for window in sorted(filter(None, windows)))
        lengths = [builder.type(node).window for node in nodes]
        first = next(filter(None, lengths))
        odd = next(i for i, length in enumerate(lengths) if length not in (None, first))
        place = context.call.arguments[odd].span
        what, operand = f"the windows of `{context.name}`", f"{lengths[odd]} samples"
        context.refuse(shapes.wrong_axes(what, "equally long", found, place, operand=operand))
    time_axis = tuple(Axis(WINDOW, window) for window in windows if window is not None)
    return (_joined(context, nodes, time_axis),)


def read_window(context: LayerContext, settings: Windowed) -> Arguments:
    """The node of the window over which a filter runs, in a tuple: the argument over the layer's
    `window:`, or the argument's own window (R1). Reports a missing or a different window, or a
    static model, and raises LoweringFailed.
    """
    _check_count(context, "1 argument", len(context.call.arguments) == 1)
    lowering, argument = context.lowering, context.call.arguments[0]
    is_window = isinstance(argument, Past | Future) or (
        isinstance(argument, Window) and argument.last is not None
    )
    if settings.window is not None and not is_window:
        taps = lowering.sampling.samples(settings.window)
        if lowering.sampling.sample_time is None:
            context.refuse(time.needs_sample_time("a `window:`", argument.span))
        return (window_of(lowering, argument, context.environment, 1 - taps, 0),)
    node = lower(lowering, argument, context.environment)
    found = context.builder.type(node).window
    if found is None:
        context.refuse(shapes.window_needed(context.name, argument.span))
    if settings.window is not None and lowering.sampling.samples(settings.window) != found:
        wanted = f"{lowering.sampling.samples(settings.window)} samples"
        what = f"the window of `{context.name}`"
        context.refuse(shapes.wrong_axes(what, wanted, f"{found} samples", argument.span))
    return (node,)


def _joined(context: LayerContext, nodes: list[NodeId], time_axis: tuple[Axis, ...]) -> NodeId:
    """The elements of all `nodes`, concatenated along one unnamed axis, before the axis `time_axis`
    if there is one. The unit is unknown if the units differ.
    """
    builder = context.builder
    units = [builder.type(node).unit for node in nodes]
    unit = units[0]
    # the result is one array, which has one unit
    if any(unit is None or other is None or not same_unit(unit, other) for other in units):
        unit = None
    parts: list[NodeId] = []
    for node in nodes:
        elements = context.elements(node)
        count = math.prod(axis.size for axis in elements)
        spread = builder.broadcast(node, (*elements, *time_axis))
        axes = (Axis(UNNAMED, count), *time_axis)
        parts.append(builder.emit(Reshape(), (spread,), Type(axes, unit)))
    return builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]


def _check_count(context: LayerContext, wanted: str, fits: bool) -> None:
    call = context.call
    for keyword in call.keywords:
        context.refuse(names.unknown_keyword(context.name, keyword.name, keyword.span, ()))
    if not fits:
        found = len(call.arguments)
        context.refuse(names.wrong_argument_count(context.name, wanted, found, call.span))


def named_array(context: LayerContext, reference: Located[str], axes: tuple[Axis, ...]) -> NodeId:
    """The node of the parameter that `reference` names, with the axes of the cells of a local model
    followed by `axes`.

    Dims of the spec must be equal. Windows, list elements and internal axes of the layer have no
    name in the spec, so only their sizes must match. Reports anything else and raises
    LoweringFailed.
    """
    lowering, name, place = context.lowering, reference.value, reference.span
    declared = lowering.names.declared(name, place)
    if not isinstance(declared.entry, Parameter):
        problem = f"`{name}` is {declared.kind.value}, not a parameter"
        repair = "name one of `parameters:`"
        context.refuse(names.unfit_setting(f"`{context.name}`", problem, place, repair))
    context.stores.arrays.parameter(name, declared.entry)
    node = context.stores.arrays.read(context.builder, name)
    full = (*context.cells, *axes)
    found = context.builder.type(node).axes
    fits = len(found) == len(full) and all(
        own.size == wanted.size and (own.name == wanted.name or not _is_dim(context, wanted))
        for own, wanted in zip(found, full, strict=True)
    )
    if not fits:
        declared_at = declared.entry.place.key
        asked = (axis if _is_dim(context, axis) else Axis("any", axis.size) for axis in full)
        needs, has = describe_axes(tuple(asked)), describe_axes(found)
        report = shapes.unfit_parameter(context.name, name, needs, has, place, declared_at)
        context.refuse(report)
    return context.builder.reshape(node, full)


def _is_dim(context: LayerContext, axis: Axis) -> bool:
    return axis.name in context.lowering.scope
