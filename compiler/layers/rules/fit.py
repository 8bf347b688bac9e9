"""Declares what `fit:` makes a linear system follow before training begins."""

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
    """The kind of linear system that a layer is."""

    kind: FilterKind
    num: int
    den: int
    feedthrough: bool = True
    radius: float = 1.0
    out: tuple[Axis, ...]
    """The axes of its value."""


def declare_fit(
    context: LayerContext, wanted: Prediction, argument: NodeId, orders: Orders
) -> None:
    """Notes what the layer starts at; refuses what is no system from inputs to a signal.

    A layer of a sub-model whose input is connected has no input of the data to follow, and one
    with given or frozen weights has nothing to find: they start as they would without `fit`.
    """
    lowering, name = context.lowering, context.name
    if owner_of(name) and _is_connected(context):
        return
    arrays = filter_arrays(orders.kind, orders.feedthrough)
    # weights that are given or frozen are not to be found
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
    # called twice with the same argument it is one system still
    if context.stores.fits.setdefault(name, fit) != fit:
        problem = f"`fit` is for one argument, and `{name}` is called with two"
        _refuse(context, problem, context.call.arguments[0].span, "this argument")


def _graph_of(context: LayerContext, argument: NodeId) -> Graph:
    """Lowers the layer's argument in a graph of its own."""
    graph, own = context.builder.graph(), GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    # nodes stand after their operands: none that comes later is needed
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
    """Whether the arguments read what a parent feeds, through anything."""
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
