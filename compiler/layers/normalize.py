"""`normalize`: a value minus its mean, divided by its standard deviation; `NAME.inverse(…)` is the
inverse.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from compiler.ir.program import NodeId, Statistic
from compiler.ir.rules import distance_unit
from compiler.ir.types import Axis, describe_axes
from compiler.layers.rules.arguments import read_value
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from compiler.linking.link import Connected
from compiler.lowering.constants import evaluate, refuse_infinite
from spec_schema.errors import names, shapes
from spec_schema.expressions.tree import Expression, Future, Member, Name, Past, Window
from spec_schema.sections.layer_kinds import Normalize
from spec_schema.sections.signals import Signal
from spec_schema.units.unit import Unit


def normalize(context: LayerContext, settings: Normalize, arguments: Arguments) -> NodeId:
    """y = (x − mean) / std, dimensionless; `mean` and `std` are `data` or numbers in the unit of x.

    A list has one number for each element of the last axis of x besides the window. With `data`
    they are mean and standard deviation (divisor n) of an input or target over the training rows,
    for each of its elements. That signal is x, or the one that `of:` names. They are set once,
    before the first stage, and stored with the weights as arrays `mean`, `std`; they are not
    learned. `NAME.inverse(y)` is y · std + mean, in the layer's `unit:` if there is one.
    """
    (value,) = arguments
    builder = context.builder
    unit = builder.type(value).unit
    mean, std = _numbers(context, settings, value, unit)
    return builder.divide(builder.subtract(value, mean), std)


def _inverse(context: LayerContext, settings: Normalize, arguments: Arguments) -> NodeId:
    (value,) = arguments
    builder = context.builder
    unit = settings.unit.value if settings.unit else None
    mean, std = _numbers(context, settings, value, unit, inverse=True)
    return builder.add(builder.multiply(value, std), mean)


def _numbers(
    context: LayerContext,
    settings: Normalize,
    value: NodeId,
    unit: Unit | None,
    *,
    inverse: bool = False,
) -> tuple[NodeId, NodeId]:
    """The nodes of mean and standard deviation, with the axes of `value`.

    A fixed mean gets the unit `unit`, a fixed deviation that of a difference in it (K for degC).
    `inverse` is True for a call `NAME.inverse(…)`, for whose argument `data` finds no signal.
    Reports settings that do not fit and raises LoweringFailed.
    """
    mean, std = settings.mean, settings.std
    signal = _signal(context, settings, inverse) if "data" in (mean, std) else ""
    if std != "data" and np.any(evaluate(context.lowering, std).values <= 0):
        context.refuse(names.unfit_setting("normalize", "`std` must be above 0", std.span))
    if mean == "data":
        mean_node = _measured(context, "mean", signal, value)
    else:
        mean_node = _constant(context, mean, value, unit)
    if std == "data":
        return mean_node, _measured(context, "std", signal, value)
    return mean_node, _constant(context, std, value, distance_unit(unit))


def _signal(context: LayerContext, settings: Normalize, inverse: bool) -> str:
    """The name of the signal whose data give mean and standard deviation: that of `of:`, else the
    argument of the first call. `inverse` is True for a call `NAME.inverse(…)`, whose argument is no
    signal. Reports anything but an input or target and raises LoweringFailed.
    """
    lowering, known = context.lowering, context.stores.normalized
    argument = context.call.arguments[0]
    if settings.of is not None:
        name, span = settings.of.value, settings.of.span
    # its argument is in standard units and names no signal: that of the call before counts
    elif inverse and context.name in known:
        return known[context.name]
    else:
        name, span = "" if inverse else _signal_name(argument), argument.span
    # `of:` reports a name that nothing declares; an argument may be any expression
    declared = (
        lowering.names.declared(name, span) if settings.of is not None else lowering.scope.get(name)
    )
    # one layer has one mean: all its calls must be of the signal of the first
    before = known.setdefault(context.name, name)
    if declared is None or not isinstance(declared.entry, Signal | Connected) or before != name:
        problem = "`data` takes mean and std of one input or target"
        repair = f"name it: `{context.name}: {{normalize: {{mean: data, std: data, of: SIGNAL}}}}`"
        label = "this argument" if settings.of is None else "this setting"
        context.refuse(names.unfit_setting("normalize", problem, span, repair, label))
    return name


def _signal_name(expression: Expression) -> str:
    """The name of the signal that an expression reads unchanged, at any time or over a window;
    empty for any other expression.
    """
    match expression:
        case Name(name=name):
            return name
        case Member(base=base, name="meas"):
            return base
        case Window(operand=operand) | Past(operand=operand) | Future(operand=operand):
            return _signal_name(operand)
        case _:
            return ""


def _measured(
    context: LayerContext, kind: Literal["mean", "std"], signal: str, value: NodeId
) -> NodeId:
    builder = context.builder
    entry = context.lowering.scope[signal].entry
    is_connected = isinstance(entry, Connected)
    # statistics are of data, which nobody has of an input that an equation feeds: only those that
    # came with the sub-model's weights
    if is_connected:
        entry = entry.feeds
    assert isinstance(entry, Signal)
    axes = context.lowering.axes_of(entry)
    shape = tuple(axis.size for axis in axes)
    if is_connected and context.lowering.given.value(f"{context.name}.{kind}", shape) is None:
        problem = f"no data has `{signal}`, which is connected"
        repair = "give the sub-model its `weights:`, where mean and std are"
        context.refuse(names.unfit_setting("normalize", problem, context.span, repair))
    found = builder.type(value).axes
    # each element of the signal has numbers of its own, so the argument needs all its dims
    if not set(axes) <= set(found):
        what, place = f"the argument of `{context.name}`", context.call.arguments[0].span
        context.refuse(shapes.wrong_axes(what, describe_axes(axes), describe_axes(found), place))
    unit = entry.unit.value if entry.unit else None
    unit = unit if kind == "mean" else distance_unit(unit)
    node = context.measured(kind, Statistic(kind, signal), axes, unit)
    return builder.broadcast(node, found)


def _constant(
    context: LayerContext, expression: Expression, value: NodeId, unit: Unit | None
) -> NodeId:
    builder = context.builder
    found = evaluate(context.lowering, expression)
    axes: tuple[Axis, ...] = ()
    if found.values.ndim:
        axes = context.elements(value)[-1:]
        if found.values.shape != tuple(axis.size for axis in axes):
            wanted = describe_axes(axes) if axes else "one number"
            what = f"an option of `{context.name}`"
            shown = describe_axes(found.axes)
            context.refuse(shapes.wrong_axes(what, wanted, shown, expression.span))
    what = f"an option of `{context.name}`"
    refuse_infinite(context.lowering, what, found.values, expression.span)
    number = builder.constant(found.values, axes, unit)
    return builder.broadcast(number, builder.type(value).axes)


NORMALIZE = LayerRule(Normalize, read_value, normalize, {"inverse": _inverse})
