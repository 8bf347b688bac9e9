"""Declares what `fit:` makes a linear filter follow before training begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

from compiler.ir.fit import FilterKind, Fit, filter_arrays
from compiler.layers.rules.layer_context import LayerContext
from compiler.linking.connected import Connected
from compiler.lowering.predictions import prediction_of
from compiler.lowering.scope import Kind, owner_of
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.expressions.tree import Name
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.signals import Signal, State


@dataclass(frozen=True)
class Orders:
    """What kind of filter a layer is."""

    kind: FilterKind
    num: int
    den: int
    feedthrough: bool = True
    radius: float = 1.0


def declare_fit(context: LayerContext, wanted: Prediction, orders: Orders) -> None:
    """Notes what the layer starts at; refuses what is no filter from one scalar to another.

    A layer of a sub-model whose input is connected has no input of the data to follow, and one
    with given or frozen weights has nothing to find: they start as they would without `fit`.
    """
    lowering, name = context.lowering, context.name
    argument = lowering.scope.get(_name(context))
    if owner_of(name) and argument is not None and isinstance(argument.entry, Connected):
        return
    arrays = filter_arrays(orders.kind, orders.num, orders.den, orders.feedthrough)
    if any(lowering.given.settles(f"{name}.{array}") for array in arrays):
        return
    if context.cells:
        _refuse(context, "`fit` is not for the cells of a local model", wanted.span)
    target = prediction_of(lowering, wanted, "fit")
    entry = lowering.scope[target.signal].entry
    assert isinstance(entry, Signal | State)
    if lowering.axes_of(entry):
        _refuse(context, f"`fit` needs a scalar, and `{target.signal}` is none", wanted.span)
    fit = Fit(
        kind=orders.kind,
        layer=name,
        input=_input(context),
        target=target,
        num=orders.num,
        den=orders.den,
        feedthrough=orders.feedthrough,
        radius=orders.radius,
    )
    if context.stores.fits.setdefault(name, fit) != fit:
        problem = f"`fit` is for one input, and `{name}` is called with two"
        _refuse(context, problem, context.call.arguments[0].span, "this argument")


def _input(context: LayerContext) -> str:
    """The scalar input that the layer is called with."""
    arguments, lowering = context.call.arguments, context.lowering
    name = _name(context)
    declared = lowering.scope.get(name)
    entry = declared.entry if declared and declared.kind is Kind.INPUT else None
    if not isinstance(entry, Signal) or lowering.axes_of(entry):
        problem = "`fit` needs one scalar input as the argument"
        _refuse(context, problem, arguments[0].span, "this argument")
    return name


def _name(context: LayerContext) -> str:
    """The only argument where it is a name of the spec; empty for any other."""
    match context.call.arguments:
        case (Name(name=name),) if name not in context.environment.arguments:
            return name
        case _:
            return ""


def _refuse(
    context: LayerContext, problem: str, span: Span, label: str = "this setting"
) -> NoReturn:
    called = f"`{context.name}(u)` with a scalar input u and `fit:` of a scalar signal"
    repair = f"leave `fit` out, or write {called}"
    context.refuse(names.unfit_setting(f"`{context.name}`", problem, span, repair, label))
