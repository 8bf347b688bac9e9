"""`LayerRule` describes a kind of layer; `LayerContext` is one call of a layer that is being
expanded into core operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, Generic, NoReturn, Protocol, TypeAlias, TypeVar

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Fit, NodeId, Statistic
from compiler.ir.rules import LARGEST_SIZE
from compiler.ir.scalars import Array
from compiler.ir.types import WINDOW, Axis, describe_axes
from compiler.lowering.arrays import Arrays, initial_values, uniform_draws
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment, FunctionArgument
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, shapes
from spec_schema.expressions.tree import Call, LanguageName, Name
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.values import Initializer
from spec_schema.units.unit import Unit


class CellRule(Protocol):
    """The functions of a layer that a local model uses as its cell: `read` lowers its arguments,
    `expand` builds its value.
    """

    @property
    def read(self) -> Callable[[LayerContext, Any], tuple[NodeId, ...]]: ...
    @property
    def expand(self) -> Callable[[LayerContext, Any, tuple[NodeId, ...]], NodeId]: ...


@dataclass(frozen=True, eq=False)
class LayerStores:
    """State that the layers of one compilation share between their calls."""

    arrays: Arrays
    first_calls: dict[str, str] = field(default_factory=dict[str, str])
    """Shapes of the arguments of each layer's first call, as text."""
    normalized: dict[str, str] = field(default_factory=dict[str, str])
    """The signal whose statistics each `normalize` layer uses."""
    fits: dict[str, Fit] = field(default_factory=dict[str, Fit])
    """The initial fit of each layer with `fit:`."""
    known_units: Mapping[str, Unit] = field(default_factory=dict[str, Unit])
    """Units of centres from the previous lowering, for centres that are read before a call."""
    argument_units: dict[str, Unit] = field(default_factory=dict[str, Unit])
    """The unit of the argument of each fuzzify layer's first call."""
    read_uncalled: set[str] = field(default_factory=set[str])
    """Layers of which `NAME.centers` is read; the unit of the centres comes from a call, which may
    be later."""

    def found_units(self) -> Mapping[str, Unit]:
        """The units of the centres that are read as `NAME.centers`, by layer, as far as this
        lowering knows them.
        """
        called = self.argument_units
        return {name: called[name] for name in sorted(self.read_uncalled & called.keys())}


@dataclass(frozen=True, kw_only=True)
class LayerContext:
    """One call of a layer, with the methods by which the layer declares arrays and reports
    mistakes.
    """

    name: str
    """Name of the layer in the spec; its arrays are named `name.weight` and so on."""
    lowering: Context
    stores: LayerStores
    call: Call
    environment: Environment
    span: Span
    """Place of the layer's declaration."""
    rule_of: Callable[[Entry], CellRule] = field(repr=False)
    """Returns the rule for the settings of another layer, for layers that contain layers."""
    cells: tuple[Axis, ...] = ()
    """Axes of a local model's activations: every cell has its own weights."""
    called_with: str = ""
    """Shapes of the arguments, as text for messages."""

    @property
    def builder(self) -> GraphBuilder:
        """The builder of the graph to which the nodes of the call belong."""
        return self.lowering.builder(self.environment)

    def in_cells(self, cells: tuple[Axis, ...]) -> LayerContext:
        """The context in which a local model expands its cell: each array of the layer gets the
        axes `cells` in front.
        """
        return replace(self, cells=(*self.cells, *cells))

    def refuse(self, diagnostic: Diagnostic) -> NoReturn:
        """Reports the mistake `diagnostic` and raises LoweringFailed."""
        self.lowering.findings.report(diagnostic)
        raise LoweringFailed

    def axis(self, dimension: Located[str]) -> Axis:
        """The axis of a dimension that `dims:` declares. Reports an unknown one and raises
        LoweringFailed.
        """
        return self.lowering.dimension(dimension.value, dimension.span)

    def out(self, dimension: Located[str] | None) -> tuple[Axis, ...]:
        """The axis of `dimension`, the option `out:`, in a tuple; empty (a scalar) without the
        option. Reports an unknown dimension and raises LoweringFailed.
        """
        return (self.axis(dimension),) if dimension else ()

    def own_axis(self, suffix: str, size: int) -> Axis:
        """An internal axis of the layer of this size, named `layer.suffix`. Dimensions of the spec
        have no such dot.
        """
        return Axis(f"{self.name}.{suffix}", size)

    def elements(self, node: NodeId) -> tuple[Axis, ...]:
        """The axes of one sample of a node's value: all except the window."""
        return tuple(axis for axis in self.builder.type(node).axes if axis.name != WINDOW)

    def learned(
        self,
        suffix: str,
        axes: tuple[Axis, ...],
        initial: Array | float,
        doc: str,
        *,
        unit: Unit | None = None,
        low: float | None = None,
        high: float | None = None,
    ) -> NodeId:
        """The node of the learnable array `layer.suffix` with the axes of the cells followed by
        `axes`.

        `initial` has that shape or is broadcast to it; `low` and `high` are bounds, `doc` describes
        the array in reports. Reports a second call whose arguments need other axes, and raises
        LoweringFailed.
        """
        full = self._admitted(axes)
        values = np.broadcast_to(np.asarray(initial, dtype=float), [axis.size for axis in full])
        type = self.stores.arrays.declare(
            f"{self.name}.{suffix}", full, values, unit, doc, self.span, (low, high)
        )
        # the first call declared it, with the axes of its arguments
        if type.axes != full:
            self._called_differently()
        return self.stores.arrays.read(self.builder, f"{self.name}.{suffix}")

    def measured(
        self, suffix: str, statistic: Statistic, axes: tuple[Axis, ...], unit: Unit | None
    ) -> NodeId:
        """The node of the array `layer.suffix`, which training sets to a statistic of its data.
        Before, it is 0 for a mean, 1 for a standard deviation.
        """
        name = f"{self.name}.{suffix}"
        values = np.full([axis.size for axis in axes], 0.0 if statistic.kind == "mean" else 1.0)
        doc = f"{statistic.kind} of `{statistic.signal}` in the training data"
        arrays = self.stores.arrays
        arrays.declare(name, axes, values, unit, doc, self.span, (None, None), statistic)
        return arrays.read(self.builder, name)

    def initial(
        self, suffix: str, initializer: Initializer | None, axes: tuple[Axis, ...], bound: float
    ) -> Array:
        """The initial values of the array `layer.suffix`: those of `init:` (`initializer`),
        otherwise uniform random values in ±bound that depend on the array's name. They have the
        axes of the cells followed by `axes`. Raises LoweringFailed after reporting a mistake in
        `init:`.
        """
        full = self._admitted(axes)
        name = f"{self.name}.{suffix}"
        if initializer is not None:
            return initial_values(self.lowering, name, initializer, full)
        shape = [axis.size for axis in full]
        return uniform_draws(name, -bound, bound, shape, self.lowering.draw)

    def dropout(self, value: NodeId, rate: float) -> NodeId:
        """The value, of which training sets each element to 0 with probability `rate`; the value
        itself if that is 0.
        """
        return self.builder.dropout(value, rate, self.name) if rate else value

    def apply(self, function: Located[str], nodes: Sequence[NodeId]) -> NodeId:
        """The node of a builtin, or a function of the spec, of the operands `nodes`, which have
        equal axes.

        The result must have these axes. A function that adds or removes an axis is reported and
        raises LoweringFailed.
        """
        span = function.span
        # names of a spec never start with "_", so these arguments cannot collide
        arguments = {f"_{index}": node for index, node in enumerate(nodes)}
        inner = replace(
            self.environment,
            arguments={
                name: FunctionArgument(
                    Name(name, span),
                    self.environment,
                    {self.environment.time: node},
                    at_hand=True,
                )
                for name, node in arguments.items()
            },
        )
        given = tuple(Name(name, span) for name in arguments)
        # in a sub-model every declared name has a dot
        is_language = self.lowering.is_of_submodel(self.name) and "." not in function.value
        kind = LanguageName if is_language else Name
        result = self.lowering.names.call(Call(kind(function.value, span), given, (), span), inner)
        axes = self.builder.type(nodes[0]).axes
        found = self.builder.type(result).axes
        if set(found) != set(axes):
            what = f"the value of `{function.value}`"
            self.refuse(shapes.wrong_axes(what, describe_axes(axes), describe_axes(found), span))
        return self.builder.broadcast(result, axes)

    def with_arguments(self, nodes: Sequence[NodeId]) -> LayerContext:
        """The context of a call whose arguments are the nodes `nodes`. Their shapes are stored at
        the layer's first call, for a message about a different second call.
        """
        shapes_of = " and ".join(describe_axes(self.builder.type(node).axes) for node in nodes)
        self.stores.first_calls.setdefault(self.name, shapes_of)
        return replace(self, called_with=shapes_of)

    def _admitted(self, axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
        """The axes of an array of the layer: those of a local model's cells, if any, then `axes`.

        Reports an array that is too large, and raises LoweringFailed.
        """
        full = (*self.cells, *axes)
        count = math.prod(axis.size for axis in full)
        if count > LARGEST_SIZE:
            problem = f"an array of it would have {count} elements"
            self.refuse(names.unfit_setting(f"`{self.name}`", problem, self.span))
        return full

    def _called_differently(self) -> NoReturn:
        before = self.stores.first_calls[self.name]
        place = self.call.arguments[0].span
        self.refuse(shapes.layer_called_differently(self.name, before, self.called_with, place))


S = TypeVar("S", bound=Entry)

Arguments: TypeAlias = tuple[NodeId, ...]
Expansion: TypeAlias = Callable[[LayerContext, S, Arguments], NodeId]
Reading: TypeAlias = Callable[[LayerContext, S], NodeId]


@dataclass(frozen=True)
class LayerRule(Generic[S]):
    """The rule of one kind of layer: how its arguments are read and how it expands into core
    operations.

    In a local model it expands in a context with the axes of the cells.
    """

    settings: type[S]
    """The class of its settings in the schema."""
    read: Callable[[LayerContext, S], Arguments]
    """Checks and lowers the arguments of a call; one of the functions of `arguments.py`."""
    expand: Expansion[S]
    """Builds the value of the layer from core operations."""
    members: Mapping[str, Expansion[S]] = field(default_factory=dict[str, "Expansion[S]"])
    """Expansions of calls `NAME.member(expr)`."""
    values: Mapping[str, Reading[S]] = field(default_factory=dict[str, "Reading[S]"])
    """Values that are read as `NAME.value`, without a call."""
    is_black_box: bool = False
    """True if single parameters have no meaning, as in a neural network: other parameters give
    the same function, or one that no data distinguish from it."""


AnyRule: TypeAlias = LayerRule[Any]
"""A rule of the registry; its functions accept only settings of its own class."""
