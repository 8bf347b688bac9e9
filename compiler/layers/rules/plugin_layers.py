"""Context, rule and readers of arguments for the layers of plug-ins. They are those of the core's
layers, but with the checked nodes of `plugin_nodes.py`.

`msnn.extending` has `PluginContext` as `LayerContext` and `PluginRule` as `LayerRule`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, Generic, NoReturn, TypeAlias, TypeVar, cast

import numpy as np

from compiler.ir.scalars import Array
from compiler.ir.types import Axis
from compiler.layers.rules import arguments as readers
from compiler.layers.rules.layer_rule import AnyRule, LayerContext, LayerRule
from compiler.layers.rules.plugin_nodes import (
    PluginBuilder,
    PluginNode,
    checked,
    fault_of_node,
    guarded_expansion,
    index_in,
)
from compiler.lowering.context import LoweringFailed, Sampling
from spec_schema import registry
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.names import is_name
from spec_schema.plugins import PluginPart
from spec_schema.units.unit import Unit


class PluginContext:
    """One call of a layer of a plug-in, with the methods by which the layer declares arrays and
    reports mistakes.
    """

    def __init__(self, context: LayerContext) -> None:
        self.inner = context
        """The context of a layer of msnn, which changes without notice."""
        self._declared: set[str] = set()

    @property
    def name(self) -> str:
        """Name of the layer in the spec; its arrays are named `name.weight` and so on."""
        return self.inner.name

    @property
    def span(self) -> Span:
        """The place of the layer's declaration in the spec."""
        return self.inner.span

    @property
    def builder(self) -> PluginBuilder:
        """The builder of the graph to which the nodes of the call belong."""
        return PluginBuilder(self.inner.builder)

    @property
    def sampling(self) -> Sampling:
        """Converts durations to samples. `sampling.sample_time` is in seconds; None in a static
        model.
        """
        return self.inner.lowering.sampling

    def refuse(self, diagnostic: Diagnostic) -> NoReturn:
        """Reports a mistake of the spec, and ends the call by raising LoweringFailed. Raises
        TypeError if `diagnostic` is none, or no error.
        """
        found = checked(diagnostic, Diagnostic, "a Diagnostic: write `error(...)`")
        if found.severity != "error":
            raise TypeError(f"a {found.severity} refuses nothing: write `error(...)`")
        self.inner.refuse(found)

    def axis(self, dimension: Located[str]) -> Axis:
        """The axis of a dimension that `dims:` declares. Reports an unknown one and ends
        the call.
        """
        return self.inner.axis(dimension)

    def out(self, dimension: Located[str] | None) -> tuple[Axis, ...]:
        """The axis of `dimension`, the option `out:`, in a tuple; empty (a scalar) without the
        option. Reports an unknown dimension and ends the call.
        """
        return self.inner.out(dimension)

    def own_axis(self, suffix: str, size: int) -> Axis:
        """An internal axis of the layer of this size, named `layer.suffix`. Dimensions of the spec
        have no such dot.
        """
        return self.inner.own_axis(suffix, size)

    def elements(self, node: PluginNode) -> tuple[Axis, ...]:
        """The axes of a value other than its window. Raises TypeError if `node` is no node of the
        builder.
        """
        return self.inner.elements(index_in(self.inner.builder, node))

    def learned(
        self,
        suffix: str,
        axes: Sequence[Axis],
        initial: Array | float,
        doc: str,
        *,
        unit: Unit | None = None,
        low: float | None = None,
        high: float | None = None,
    ) -> PluginNode:
        """The node of an array that training learns, with the name `LAYER.suffix`.

        `initial` has the shape of the axes, or is one number. `low` and `high` are its bounds.
        `doc` describes the array. Raises ValueError for a suffix that is no name or is declared
        before in this call, and for an empty or repeated axis. The same holds for bounds without
        room, and for an initial value that is not finite or not within them. Raises TypeError for
        an argument of a wrong class.
        """
        name = checked(suffix, str, "the name of a learned array")
        if not is_name(name):
            raise ValueError(f"{name!r} is no name of a learned array: use letters, digits and `_`")
        if name in self._declared:
            raise ValueError(f"the learned array `{name}` is declared twice in one call")
        self._declared.add(name)
        checked(doc, str, "the sentence about a learned array")
        if unit is not None:
            checked(unit, Unit, "a `msnn.extending.Unit`: write `parse_unit('m/s')`")
        values = np.asarray(initial, dtype=float)
        least, most = (_bound(name, bound) for bound in (low, high))
        if least is not None and most is not None and not least < most:
            raise ValueError(f"`low` of `{name}` is {least:g}, which is not below `high` {most:g}")
        if not np.all(np.isfinite(values)):
            raise ValueError(f"an initial value of `{name}` is not finite")
        lowest = -math.inf if least is None else least
        highest = math.inf if most is None else most
        outside = values[(values < lowest) | (values > highest)]
        if outside.size:
            bounds = f"{lowest:g} … {highest:g}"
            raise ValueError(f"the initial value {outside[0]:g} of `{name}` is not in {bounds}")
        axes = tuple(checked(axis, Axis, "a `msnn.extending.Axis`") for axis in axes)
        if min((axis.size for axis in axes), default=1) < 1:
            raise ValueError(f"`{name}` has an empty axis")
        if len({axis.name for axis in axes}) < len(axes):
            raise ValueError(f"`{name}` has an axis twice")
        node = self.inner.learned(name, axes, values, doc, unit=unit, low=least, high=most)
        return PluginNode(node, self.inner.builder)

    def apply(self, function: Located[str], nodes: Sequence[PluginNode]) -> PluginNode:
        """The node of a function that the spec names, a builtin or one of its own, applied to
        operands of equal axes. The result must have these axes; otherwise it is reported and the
        call ends.
        """
        builder = self.inner.builder
        indices = [index_in(builder, node) for node in nodes]
        return PluginNode(self.inner.apply(function, indices), builder)


def _bound(name: str, bound: float | None) -> float | None:
    if bound is None:
        return None
    number = float(bound)
    if not math.isfinite(number):
        raise ValueError(f"a bound of `{name}` is not finite: leave it out for no bound")
    return number


PluginArguments: TypeAlias = tuple[PluginNode, ...]
S = TypeVar("S", bound=Entry)


@dataclass(frozen=True)
class PluginRule(Generic[S]):
    """The rule of a plug-in's layer: the class of its settings, the reader of its arguments and its
    expansion into core operations.
    """

    settings: type[S]
    """The class of its settings, as its line names it."""
    read: Callable[[PluginContext, S], PluginArguments]
    """Checks and lowers the arguments of a call: `read_value` or another reader."""
    expand: Callable[[PluginContext, S, PluginArguments], PluginNode]
    """Builds the value of the layer from core operations."""
    members: Mapping[str, Callable[[PluginContext, S, PluginArguments], PluginNode]] = field(
        default_factory=dict[str, Callable[..., PluginNode]]
    )
    """Expansions of calls `NAME.member(expr)`."""
    values: Mapping[str, Callable[[PluginContext, S], PluginNode]] = field(
        default_factory=dict[str, Callable[..., PluginNode]]
    )
    """Values that are read as `NAME.value`, without a call."""
    is_black_box: bool = False
    """True if single parameters have no meaning, as in a neural network."""


def _nodes(context: PluginContext, indices: Sequence[int]) -> PluginArguments:
    return tuple(PluginNode(index, context.inner.builder) for index in indices)


def read_values(context: PluginContext, count: int) -> PluginArguments:
    """The nodes of a call's arguments. Reports an error unless there are exactly `count`, and ends
    the call by raising LoweringFailed.
    """
    return _nodes(context, readers.read_values(context.inner, count))


def read_value(context: PluginContext, settings: Entry) -> PluginArguments:
    """The node of a call's only argument, of any shape, in a tuple; `settings` have no effect.
    Raises LoweringFailed after reporting another number of arguments.
    """
    del settings
    return read_values(context, 1)


def read_scalars(context: PluginContext, count: int) -> PluginArguments:
    """The nodes of exactly `count` arguments, which may have a window but no other axes. Otherwise
    reports the mistake and raises LoweringFailed.
    """
    return _nodes(context, readers.read_scalars(context.inner, count))


def read_elements(context: PluginContext, settings: Entry) -> PluginArguments:
    """One node with at least one axis besides the window, in a tuple: the only argument, or the
    elements of all arguments concatenated. Raises LoweringFailed after reporting a mistake.
    """
    return _nodes(context, readers.read_elements(context.inner, settings))


def read_window(context: PluginContext, settings: readers.Windowed) -> PluginArguments:
    """The node of the window over which a filter runs, in a tuple: the argument over
    `settings.window`, or the argument's own window. Raises LoweringFailed after reporting a missing
    or different one.
    """
    return _nodes(context, readers.read_window(context.inner, settings))


def rule_of_plugin(line: registry.LayerLine) -> AnyRule:
    """The rule of the plug-in's layer that `line` of the registry lists. Its functions are wrapped,
    so that their mistakes raise SpecError (E0230), which names the plug-in.
    """
    part = PluginPart("layer", line.key, line.rule.module, (LoweringFailed,))
    found: object = line.rule.value
    if not isinstance(found, PluginRule):
        raise part.fault(f"is a {type(found).__name__}, not a LayerRule")
    rule = cast("PluginRule[Any]", found)
    if rule.settings is not line.entry.kind:
        wanted = f"the class of its line is {line.entry.name}"
        raise part.fault(f"has a rule for settings of {rule.settings.__name__}, and {wanted}")

    def read(context: LayerContext, settings: Entry) -> tuple[int, ...]:
        def fault(nodes: object, *arguments: object) -> str | None:
            del arguments
            if not isinstance(nodes, tuple):
                return f"read a {type(nodes).__name__}, not a tuple of nodes"
            found = cast("tuple[object, ...]", nodes)
            faults = (fault_of_node(node, context.builder) for node in found)
            return next((f"read {each}" for each in faults if each is not None), None)

        def place(*arguments: object) -> Span:
            del arguments
            return context.span

        nodes = part.guarded(rule.read, fault, place)(PluginContext(context), settings)
        return tuple(node.index for node in nodes)

    def guarded(function: Callable[..., object]) -> Callable[..., int]:
        def expand(context: LayerContext, settings: Entry, *arguments: tuple[int, ...]) -> int:
            own = PluginContext(context)
            # a value such as `NAME.value` has none
            nodes = (_nodes(own, each) for each in arguments)
            place, builder = context.span, context.builder
            return guarded_expansion(part, function, builder, place, own, settings, *nodes)

        return expand

    return LayerRule(
        rule.settings,
        read,
        guarded(rule.expand),
        {name: guarded(member) for name, member in rule.members.items()},
        {name: guarded(value) for name, value in rule.values.items()},
        rule.is_black_box,
    )
