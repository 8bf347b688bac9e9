"""Lowers a call of a layer by the rule of its kind."""

from __future__ import annotations

from compiler import layers
from compiler.ir.program import NodeId
from compiler.layers.rules.layer_context import LayerContext, LayerStores
from compiler.layers.rules.layer_rule import AnyRule
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Member
from spec_schema.fields.entry import Entry
from spec_schema.sections.layers.layer import Layer


def lower_layer(
    lowering: Context,
    stores: LayerStores,
    name: str,
    entry: Layer,
    call: Call,
    environment: Environment,
) -> NodeId:
    """The node of `NAME(…)`, or of `NAME.member(…)` if this kind of layer has such a member."""
    settings = entry.chosen()
    rule = rule_of(settings)
    expand = rule.expand
    if isinstance(call.function, Member):
        member = rule.members.get(call.function.name)
        if member is None:
            lowering.findings.report(
                names.no_layer_member(
                    name, call.function.name, call.function.span, rule.members, rule.values
                )
            )
            raise LoweringFailed
        expand = member
    context = _context(lowering, stores, name, entry, call, environment)
    arguments = rule.read(context, settings)
    return expand(context.with_arguments(arguments), settings, arguments)


def member_of_layer(
    lowering: Context,
    stores: LayerStores,
    member: Member,
    entry: Layer,
    environment: Environment,
) -> NodeId:
    """The node of `NAME.value` without a call: a value that this kind of layer defines.

    Losses, which are lowered last, can also read a learned array: `NAME.weight`.
    """
    settings = entry.chosen()
    rule = rule_of(settings)
    if member.name in rule.values:
        call = Call(member, (), (), member.span)
        context = _context(lowering, stores, member.base, entry, call, environment)
        return rule.values[member.name](context, settings)
    arrays = stores.arrays.of_layer(member.base)
    if environment.part is EnvironmentPart.LOSS and member.name in arrays:
        return stores.arrays.read(lowering.builder(environment), f"{member.base}.{member.name}")
    lowering.findings.report(
        names.no_value_of_layer(
            member.base,
            member.name,
            member.span,
            arrays=arrays,
            values=rule.values,
            members=rule.members,
            in_loss=environment.part is EnvironmentPart.LOSS,
        )
    )
    raise LoweringFailed


def _context(
    lowering: Context,
    stores: LayerStores,
    name: str,
    entry: Layer,
    call: Call,
    environment: Environment,
) -> LayerContext:
    return LayerContext(
        name=name,
        lowering=lowering,
        stores=stores,
        call=call,
        environment=environment,
        span=entry.place.key,
        rule_of=rule_of,
    )


def rule_of(settings: Entry) -> AnyRule:
    """The rule for a layer's settings."""
    return layers.rule_of(type(settings))
