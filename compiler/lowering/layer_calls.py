"""A call of a declared layer: its arguments, window and settings, then the layer's own file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from compiler.alignment import AxisConflict
from compiler.layers.fir import fir
from compiler.layers.fuzzify import gaussian, rectangular, triangular
from compiler.layers.layer_context import LayerContext
from compiler.layers.linear import linear
from compiler.layers.local_model import local_model
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import lower, lower_all, window_of
from compiler.lowering.failure import LoweringFailed
from compiler.program import NodeId
from compiler.scalar_functions import Array
from compiler.types import UNNAMED, WINDOW, Axis, describe_axes
from spec_schema.errors import names, shapes, time
from spec_schema.expression import Call, Expression, Future, Past, Window
from spec_schema.layers import Fir, Fuzzify, Layer, Linear, LocalModel
from spec_schema.located import Located
from spec_schema.values import Initializer

if TYPE_CHECKING:
    from compiler.lowering.model import Model


def lower_layer(
    model: Model, name: str, entry: Layer, call: Call, environment: Environment
) -> NodeId:
    """The node of a layer's value."""
    if len(call.arguments) != 1 or call.keywords:
        found = len(call.arguments) + len(call.keywords)
        model.findings.report(names.wrong_argument_count(name, "1 argument", found, call.span))
        raise LoweringFailed
    builder = model.builder(environment)
    context = LayerContext(name, builder, model.arrays, entry.place.key, model.dimension)
    expansion = _Expansion(model, context, call, environment)
    try:
        node = expansion.layer(entry.choice)
    except AxisConflict as conflict:
        before = model.arrays.shape_of(f"{name}.weight")
        model.findings.report(
            shapes.layer_called_differently(
                name,
                describe_axes(before or conflict.left),
                describe_axes(conflict.right),
                call.arguments[0].span,
            )
        )
        raise LoweringFailed from conflict
    return node


class _Expansion:
    """One call being expanded."""

    def __init__(
        self, model: Model, context: LayerContext, call: Call, environment: Environment
    ) -> None:
        self._model = model
        self._context = context
        self._argument = call.arguments[0]
        self._environment = environment

    def layer(self, settings: Fir | Linear | Fuzzify | LocalModel) -> NodeId:
        match settings:
            case Fir():
                return self._fir(settings, self._context, self._windowed(settings))
            case Linear():
                value = lower(self._model, self._argument, self._environment)
                return self._linear(settings, self._context, value)
            case Fuzzify():
                return self._fuzzify(settings)
            case LocalModel():
                return self._local_model(settings)

    def _windowed(self, settings: Fir) -> NodeId:
        """The window that a filter runs over: its own of the argument, or the argument's (R1)."""
        model, argument = self._model, self._argument
        is_window = isinstance(argument, Past | Future) or (
            isinstance(argument, Window) and argument.last is not None
        )
        if settings.window is not None and not is_window:
            taps = model.sampling.samples(settings.window)
            if model.sampling.sample_time is None:
                model.findings.report(time.needs_sample_time("a `window:`", argument.span))
                raise LoweringFailed
            return window_of(model, argument, self._environment, 1 - taps, 0)
        node = lower(model, argument, self._environment)
        found = model.builder(self._environment).type(node).window
        if found is None:
            model.findings.report(shapes.window_needed(self._context.name, argument.span))
            raise LoweringFailed
        if settings.window is not None and model.sampling.samples(settings.window) != found:
            wanted = f"{model.sampling.samples(settings.window)} samples"
            model.findings.report(
                shapes.wrong_axes(
                    f"the window of `{self._context.name}`",
                    wanted,
                    f"{found} samples",
                    argument.span,
                )
            )
            raise LoweringFailed
        return node

    def _fir(self, settings: Fir, context: LayerContext, window: NodeId) -> NodeId:
        elements = tuple(a for a in context.builder.type(window).axes if a.name != WINDOW)
        out = self._out(settings.out)
        taps = context.builder.type(window).window
        assert taps is not None
        axes = (*((out,) if out else ()), *elements, Axis(WINDOW, taps))
        initial = self._initial(settings.init, context, axes)
        return fir(context, window, out, settings.bias, initial)

    def _linear(self, settings: Linear, context: LayerContext, value: NodeId) -> NodeId:
        out = self._out(settings.out)
        axes = [a for a in context.builder.type(value).axes if a.name != WINDOW]
        summed = axes[-1] if axes else Axis(UNNAMED, 1)
        initial = self._initial(settings.init, context, (*((out,) if out else ()), summed))
        return linear(context, value, out, settings.bias, initial)

    def _fuzzify(self, settings: Fuzzify) -> NodeId:
        model = self._model
        if settings.learn:
            model.findings.report(
                names.unfit_setting(
                    "fuzzify", "learned centres are not in this version", settings.place.key
                )
            )
            raise LoweringFailed
        centers = model.arrays.evaluate(settings.centers).values.ravel()
        if np.any(np.diff(centers) <= 0) or not np.all(np.isfinite(centers)):
            model.findings.report(
                names.unfit_setting("fuzzify", "the centres must ascend", settings.centers.span)
            )
            raise LoweringFailed
        axis = Axis(UNNAMED, len(centers))
        if settings.dim is not None:
            axis = model.dimension(settings.dim.value, settings.dim.span)
            if axis.size != len(centers):
                found = f"{len(centers)} centres"
                model.findings.report(
                    shapes.wrong_axes(
                        f"`{axis.name}`", f"{axis.size} centres", found, settings.centers.span
                    )
                )
                raise LoweringFailed
        value = lower(model, self._argument, self._environment)
        builder = self._context.builder
        others = [a for a in builder.type(value).axes if a.name != WINDOW]
        if others:
            model.findings.report(
                shapes.wrong_axes(
                    f"the argument of `{self._context.name}`",
                    "a scalar",
                    describe_axes(tuple(others)),
                    self._argument.span,
                )
            )
            raise LoweringFailed
        match settings.membership:
            case "triangular":
                return triangular(builder, value, axis, centers)
            case "rectangular":
                return rectangular(builder, value, axis, centers)
            case "gaussian":
                return gaussian(builder, value, axis, centers, _widths(centers))

    def _local_model(self, settings: LocalModel) -> NodeId:
        model = self._model
        cell = settings.cell.choice
        argument = (
            self._windowed(cell)
            if isinstance(cell, Fir)
            else lower(model, self._argument, self._environment)
        )
        activations = lower_all(model, settings.by, self._environment)
        axes = [
            self._activation_axis(expression, node)
            for expression, node in zip(settings.by, activations, strict=True)
        ]

        def expand(context: LayerContext) -> NodeId:
            if isinstance(cell, Fir):
                return self._fir(cell, context, argument)
            return self._linear(cell, context, argument)

        return local_model(self._context, activations, axes, expand)

    def _activation_axis(self, expression: Expression, node: NodeId) -> Axis:
        axes = [a for a in self._context.builder.type(node).axes if a.name != WINDOW]
        if len(axes) != 1:
            self._model.findings.report(
                shapes.wrong_axes(
                    "an activation of a local model",
                    "degrees of membership along one axis",
                    describe_axes(tuple(axes)),
                    expression.span,
                )
            )
            raise LoweringFailed
        return axes[0]

    def _out(self, out: Located[str] | None) -> Axis | None:
        return self._model.dimension(out.value, out.span) if out else None

    def _initial(
        self, initializer: Initializer | None, context: LayerContext, axes: Sequence[Axis]
    ) -> Array | None:
        if initializer is None:
            return None
        full = (*context.cells, *axes)
        return self._model.arrays.initial(f"{context.name}.weight", initializer, full)


def _widths(centers: Array) -> Array:
    """Half the mean distance to the neighbouring centres: sets overlap at about 0.6."""
    if len(centers) == 1:
        return np.ones(1)
    gaps = np.diff(centers)
    left = np.concatenate([gaps[:1], gaps])
    right = np.concatenate([gaps, gaps[-1:]])
    return (left + right) / 4
