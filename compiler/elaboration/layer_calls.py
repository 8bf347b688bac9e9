"""A call of a declared layer goes to the rule of its kind, which the class of its settings says."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.ir.program import NodeId
from compiler.layers import LAYERS
from compiler.layers.rules.layer_context import LayerContext
from compiler.layers.rules.layer_rule import AnyRule
from compiler.lowering.environment import Environment
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Member
from spec_schema.fields.entry import Entry
from spec_schema.sections.layers import Layer

if TYPE_CHECKING:
    from compiler.elaboration.names import Model

_RULES = {rule.settings: rule for rule in LAYERS}


def lower_layer(
    model: Model, name: str, entry: Layer, call: Call, environment: Environment
) -> NodeId:
    """The node of `NAME(…)`, or of `NAME.member(…)` where the kind of layer has such a member."""
    settings = entry.chosen()
    rule = rule_of(settings)
    expand = rule.expand
    if isinstance(call.function, Member):
        member = rule.members.get(call.function.name)
        if member is None:
            span = call.function.span
            model.findings.report(
                names.no_layer_member(name, call.function.name, span, rule.members)
            )
            raise LoweringFailed
        expand = member
    context = LayerContext(name, model, call, environment, entry.place.key, rule_of)
    arguments = rule.read(context, settings)
    return expand(context.with_arguments(arguments), settings, arguments)


def rule_of(settings: Entry) -> AnyRule:
    """The rule of a layer's settings."""
    return _RULES[type(settings)]
