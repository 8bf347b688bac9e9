"""Declares the initial fit of a filter layer (`fit:`) to a recorded signal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NoReturn

from compiler.ir.builder import GraphBuilder
from compiler.ir.fit import FilterKind, Fit, filter_arrays
from compiler.ir.graph import Graph, NodeId
from compiler.ir.graph_copy import copy_node
from compiler.ir.liveness import needed
from compiler.ir.ops import ReadState, Window
from compiler.ir.types import Axis, describe_axes
from compiler.layers.rules.layer_context import LayerContext
from compiler.linking.connected import Connected
from compiler.lowering.places.predictions import prediction_of
from compiler.lowering.scope import owner_of
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.references import names_in
from spec_schema.sections.signals import Signal, State


@dataclass(frozen=True, kw_only=True)
class Orders:
    """The kind and orders of the linear system of a layer."""

    kind: FilterKind
    num: int
    den: int
    feedthrough: bool = True
    radius: float = 1.0
    out: tuple[Axis, ...]
    """The axes of the layer's value."""


def declare_fit(
    context: LayerContext, wanted: Prediction, argument: NodeId, orders: Orders
) -> None:
    """Adds the initial fit of the layer; reports a layer that is not a system from inputs to a
    signal.

    There is no fit for a layer of a sub-model with a connected input, as its input is not recorded.
    Neither is there one for a layer with given or frozen weights.
    """
    lowering, name = context.lowering, context.name
    if owner_of(name) and _is_connected(context):
        return
    arrays = filter_arrays(orders.kind, orders.feedthrough)
    # given or frozen weights are not fitted
    if any(lowering.given.settles(f"{name}.{array}") for array in arrays):
        return
    if context.cells:
        _refuse(context, "`fit` is not for the cells of a local model", wanted.span)
    target = prediction_of(lowering, wanted, "fit")
    entry = lowering.scope[target.signal].entry
    assert isinstance(entry, Signal | State)
    axes = lowering.axes_of(entry)
    if set(axes) != set(orders.out):
        value, found = describe_axes(orders.out), describe_axes(axes)
        problem = f"its value is {value}, and `{target.signal}`, which `fit` names, is {found}"
        _refuse(context, problem, wanted.span)
    fit = Fit(
        kind=orders.kind,
        layer=name,
        argument=_graph_of(context, argument),
        target=target,
        num=orders.num,
        den=orders.den,
        feedthrough=orders.feedthrough,
        radius=orders.radius,
    )
    # two calls with the same argument are one system
    if context.stores.fits.setdefault(name, fit) != fit:
        problem = f"`fit` is for one argument, and `{name}` is called with two"
        _refuse(context, problem, context.call.arguments[0].span, "this argument")


def _graph_of(context: LayerContext, argument: NodeId) -> Graph:
    """Copies the layer's argument to a separate graph."""
    graph, own = context.builder.graph(), GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    # operands come before their users: later nodes are not needed
    for index, is_needed in enumerate(needed(graph, [argument])[: argument + 1]):
        if not is_needed:
            continue
        node = graph[index]
        if isinstance(node.op, ReadState | Window):
            problem = "`fit` needs an argument of inputs alone, and this one depends on a state"
            _refuse(context, problem, context.call.arguments[0].span, "this argument")
        copies[index] = copy_node(own, node, tuple(copies[arg] for arg in node.args))
    return own.graph()


def _is_connected(context: LayerContext) -> bool:
    """True if the arguments depend on an input that a parent model connects."""
    seen: set[str] = set()
    waiting: list[Any] = list(context.call.arguments)
    while waiting:
        for name in names_in(waiting.pop()):
            declared = context.lowering.scope.get(name)
            if declared is None or name in seen:
                continue
            if isinstance(declared.entry, Connected):
                return True
            seen.add(name)
            waiting.append(declared.entry)
    return False


def _refuse(
    context: LayerContext, problem: str, span: Span, label: str = "this setting"
) -> NoReturn:
    called = f"`{context.name}(e)` with an expression e of inputs"
    repair = f"leave `fit` out, or write {called}, and `fit:` of a signal that has its value's axes"
    context.refuse(names.unfit_setting(f"`{context.name}`", problem, span, repair, label))
