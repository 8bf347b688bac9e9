"""Layers with memory: how they read a signal, and the state that they store."""

from __future__ import annotations

from dataclasses import dataclass, replace

from compiler.ir.program import LayerMemory, NodeId, State
from compiler.ir.types import Axis, Type, describe_axes
from compiler.layers.rules.arguments import read_elements, read_value
from compiler.layers.rules.layer_context import LayerContext
from compiler.layers.rules.layer_rule import Arguments
from compiler.lowering.environment import START, EnvironmentPart
from compiler.lowering.expressions import lower
from spec_schema.errors import names, shapes, time
from spec_schema.expressions.tree import Expression
from spec_schema.fields.entry import Entry
from spec_schema.units.unit import Unit


def read_signal(context: LayerContext, settings: Entry) -> Arguments:
    """Reads one value at t."""
    return _at_one_sample(context, read_value(_in_the_step(context), settings))


def read_vector(context: LayerContext, settings: Entry) -> Arguments:
    """Reads the elements of one or several values at t, along one axis."""
    arguments = _at_one_sample(context, read_elements(_in_the_step(context), settings))
    elements = context.elements(arguments[0])
    if len(elements) != 1:
        place = context.call.arguments[0].span
        what = f"the argument of `{context.name}`"
        context.refuse(shapes.wrong_axes(what, "a vector", describe_axes(elements), place))
    return arguments


@dataclass(frozen=True)
class CallMemory:
    """The state of one call of a layer."""

    context: LayerContext
    name: str
    type: Type

    @staticmethod
    def of(
        context: LayerContext, arguments: Arguments, axes: tuple[Axis, ...], unit: Unit | None
    ) -> CallMemory:
        """The state with the axes of the cells and `axes`; one state per signal."""
        name = context.lowering.memories.name(context.name, arguments)
        return CallMemory(context, name, Type((*context.cells, *axes), unit))

    def value(self) -> NodeId:
        """The value of the state, from the previous step."""
        return self.context.builder.state(self.name, self.type)

    def becomes(self, following: NodeId, start: NodeId, doc: str) -> None:
        """Sets the value after the step, and the initial value (a node of the start graph)."""
        context, axes = self.context, self.type.axes
        state = State(
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
    """The context for the initial value of a state, evaluated from the log at t0."""
    return replace(context, environment=START)


def initial_value(
    context: LayerContext, expression: Expression | None, fits: tuple[Axis, ...]
) -> NodeId:
    """The value of `init:` at t0, 0 without it. Reports axes that are not in `fits`."""
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
    """The context of the step; at integrator stages the layer is constant over the step (R6)."""
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
