"""The layers of the language, one file each: composite operations that expand into core
operations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import import_module
from typing import cast

from compiler.ir.program import NodeId
from compiler.layers.rules.layer_rule import AnyRule, LayerContext, LayerRule
from compiler.lowering.context import LoweringFailed
from spec_schema import registry
from spec_schema.diagnostics.source import Span
from spec_schema.fields.entry import Entry
from spec_schema.plugins import PluginPart
from spec_schema.registry import LayerLine

LAYERS: Mapping[str, str] = {
    "Fir": "fir",
    "Linear": "linear",
    "Fuzzify": "fuzzify",
    "LocalModel": "local_model",
    "Mlp": "mlp",
    "EquationLearner": "equation_learner",
    "Interpolation": "interpolation",
    "Normalize": "normalize",
    "Iir": "iir",
    "StateSpace": "state_space",
    "SavitzkyGolay": "savitzky_golay",
}
"""The file of every kind of layer, by the name of the class of its settings, which is loaded as
late. Its rule has the file's name in capitals. A file is loaded with the first layer of its kind:
most specs have one kind or none."""


@cache
def rule_of(settings: type[Entry]) -> AnyRule:
    """The rule, an object with the functions that read and expand a layer, for layers whose
    settings have this class. The file of the layer is imported first.
    """
    for line in registry.LAYERS:
        if line.entry.kind is settings:
            return _rule_of_plugin(line)
    name = LAYERS[settings.__name__]
    rule: AnyRule = getattr(import_module(f"{__name__}.{name}"), name.upper())
    assert rule.settings is settings, name
    return rule


def _rule_of_plugin(line: LayerLine) -> AnyRule:
    """The rule of a plug-in's layer. Its functions are wrapped, so that their mistakes are reported
    as those of the plug-in.
    """
    # specs without plug-ins do not need it
    from compiler.layers.rules.plugin_nodes import guarded_expansion

    part = PluginPart("layer", line.key, line.rule.module, (LoweringFailed,))
    found: object = line.rule.value
    if not isinstance(found, LayerRule):
        raise part.fault(f"is a {type(found).__name__}, not a LayerRule")
    rule = cast("AnyRule", found)
    if rule.settings is not line.entry.kind:
        wanted = f"the class of its line is {line.entry.name}"
        raise part.fault(f"has a rule for settings of {rule.settings.__name__}, and {wanted}")

    def guarded(function: Callable[..., object]) -> Callable[..., NodeId]:
        def expand(context: LayerContext, *arguments: object) -> NodeId:
            with_builder = partial(function, context, *arguments)
            return guarded_expansion(part, with_builder, context.builder, context.span)

        return expand

    return LayerRule(
        rule.settings,
        part.guarded(rule.read, _fault_of_arguments, _place),
        guarded(rule.expand),
        {name: guarded(member) for name, member in rule.members.items()},
        {name: guarded(value) for name, value in rule.values.items()},
        rule.is_black_box,
    )


def _place(context: LayerContext, *arguments: object) -> Span:
    del arguments
    return context.span


def _fault_of_arguments(nodes: object, context: LayerContext, *arguments: object) -> str | None:
    del arguments
    if not isinstance(nodes, tuple):
        return f"read a {type(nodes).__name__}, not a tuple of nodes"
    from compiler.layers.rules.plugin_nodes import fault_of_result

    faults = (fault_of_result(node, context.builder) for node in cast("tuple[object, ...]", nodes))
    return next((fault for fault in faults if fault is not None), None)
