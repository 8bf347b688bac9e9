"""Layers with memory: reading their arguments, the state that they store, and their initial fit to
the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NoReturn

from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadState, Window
from compiler.ir.program import FilterKind, Fit, Graph, LayerMemory, NodeId, filter_arrays
from compiler.ir.program import State as ProgramState
from compiler.ir.types import Axis, Type, describe_axes
from compiler.layers.rules.arguments import read_elements, read_value
from compiler.layers.rules.layer_rule import Arguments, LayerContext
from compiler.linking.link import Connected
from compiler.lowering.context import owner_of
from compiler.lowering.environment import START, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.places import prediction_of
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, shapes, time
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.references import names_in
from spec_schema.sections.signals import Signal, State
from spec_schema.units.unit import Unit


def read_signal(context: LayerContext, settings: Entry) -> Arguments:
    """The node of a layer call's only argument at t, in a tuple. Reports a window, another sample
    or a call outside the step and raises LoweringFailed.
    """
    return _at_one_sample(context, read_value(_in_the_step(context), settings))


def read_vector(context: LayerContext, settings: Entry) -> Arguments:
    """One node with the elements of one or several arguments at t, along one axis, in a tuple.
    Reports a window, several axes or a call outside the step and raises LoweringFailed.
    """
    arguments = _at_one_sample(context, read_elements(_in_the_step(context), settings))
    elements = context.elements(arguments[0])
    if len(elements) != 1:
        place = context.call.arguments[0].span
        what = f"the argument of `{context.name}`"
        context.refuse(shapes.wrong_axes(what, "a vector", describe_axes(elements), place))
    return arguments


@dataclass(frozen=True)
class CallMemory:
    """The state of one call of a layer, with its name and type."""

    context: LayerContext
    name: str
    type: Type

    @staticmethod
    def of(
        context: LayerContext, arguments: Arguments, axes: tuple[Axis, ...], unit: Unit | None
    ) -> CallMemory:
        """The state of a call with these argument nodes; calls with the same arguments share one.
        It has the axes of the cells followed by `axes`.
        """
        name = context.lowering.memories.name(context.name, arguments)
        return CallMemory(context, name, Type((*context.cells, *axes), unit))

    def value(self) -> NodeId:
        """The node that reads the state at t."""
        return self.context.builder.state(self.name, self.type)

    def becomes(self, following: NodeId, start: NodeId, doc: str) -> None:
        """Sets the state's value at t+1 to the node `following`, and its value at t0 to `start`, a
        node of the start graph. Both are broadcast to the axes of the state. `doc` describes the
        state.
        """
        context, axes = self.context, self.type.axes
        state = ProgramState(
            name=self.name,
            axes=axes,
            unit=self.type.unit,
            origin=LayerMemory(),
            next=context.builder.broadcast(following, axes),
            start=starting(context).builder.broadcast(start, axes),
            doc=doc,
            span=context.span,
        )
        context.lowering.memories.keep(state)


def starting(context: LayerContext) -> LayerContext:
    """The same call in the start of the program, where the initial value of its state is computed
    at t0.
    """
    return replace(context, environment=START)


def initial_value(
    context: LayerContext, expression: Expression | None, fits: tuple[Axis, ...]
) -> NodeId:
    """The node of `init:` in the start graph; the constant 0 without it. Reports axes that are not
    in `fits` and raises LoweringFailed.
    """
    start = starting(context)
    if expression is None:
        return start.builder.constant(0.0)
    node = lower(context.lowering, expression, start.environment)
    found = start.builder.type(node).axes
    if not set(found) <= set(fits):
        what = f"`init` of `{context.name}`"
        wanted, shown = describe_axes(fits), describe_axes(found)
        context.refuse(shapes.wrong_axes(what, wanted, shown, expression.span))
    return node


def _in_the_step(context: LayerContext) -> LayerContext:
    """The context for reading the arguments at t in the step; at integrator stages the layer is
    constant during the step (R6). Reports a call elsewhere, such as in a loss or over a window, and
    raises LoweringFailed.
    """
    environment, call = context.environment, context.call
    layer = f"the layer `{context.name}`"
    if environment.part is not EnvironmentPart.STEP:
        repair = (
            "name its value in `equations:`" if environment.part is EnvironmentPart.LOSS else None
        )
        where = environment.part.value
        context.refuse(names.misplaced(context.name, where, call.function.span, repair))
    if environment.window is not None or environment.shift:
        context.refuse(time.unkept_past(layer, call.span))
    if environment.stage is None:
        return context
    if environment.arguments:
        where = "a function that a vector field calls"
        context.refuse(names.misplaced(context.name, where, call.function.span))
    # a layer stores samples, and integrator stages are between samples
    return replace(context, environment=replace(environment, stage=None))


def _at_one_sample(context: LayerContext, nodes: Arguments) -> Arguments:
    # several concatenated arguments are one node, reported at the first argument
    for node, argument in zip(nodes, context.call.arguments, strict=False):
        if context.builder.type(node).window is not None:
            what = f"the argument of `{context.name}`"
            context.refuse(shapes.wrong_axes(what, "one sample", "a window", argument.span))
    return nodes


@dataclass(frozen=True, kw_only=True)
class Orders:
    """The linear system that a layer is: its kind, the orders of numerator and denominator, and the
    maximum magnitude `radius` of its poles. `feedthrough` is True if the argument affects the
    result in the same step.
    """

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
    """Adds the initial fit of a layer, a linear system with these `orders`, from the node
    `argument` to the recorded signal that `wanted` names. Reports a layer that cannot be fitted and
    raises LoweringFailed.

    A layer of a sub-model with a connected input has no fit, as its input is not recorded. Neither
    has a layer with weights from a file or frozen ones.
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
    """A separate graph that computes the layer's argument; its last node is the value. Reports an
    argument that depends on a state and raises LoweringFailed.
    """
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
    """True if the arguments of the call depend on a connected input of a sub-model."""
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
