"""Lowers penalties: losses of a single value, some not differentiable where elements are 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from compiler.builtins.call_options import option
from compiler.builtins.reductions import reduce_axes
from compiler.ir.ops import ReadParameter
from compiler.ir.program import Loss, NodeId, Parameter
from compiler.ir.training.known import Penalty
from compiler.ir.types import UNNAMED, WINDOW, Axis, describe_axes
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import knowledge, shapes
from spec_schema.expressions.tree import Call, Name

PENALTIES = ("l1", "l2", "group")

_WORDS = {WINDOW: "samples", UNNAMED: "elements"}
"""Names of unnamed axes of arrays in docs/layers.md; the axes of a layer's arrays contain a dot."""

_LOSS = Environment(EnvironmentPart.LOSS)


def lower_penalty(context: Context, function: str, call: Call) -> tuple[NodeId, Penalty | None]:
    """The cost, and the penalised array if a proximal step can set its elements or slices to
    exactly 0.

    l1: |x| and l2: x² of each element; their mean counts. group(A, over=d): Σ over d of the
    Euclidean norm of each slice (Yuan, Lin 2006).
    """
    builder = context.builder(_LOSS)
    value = lower(context, call.arguments[0], _LOSS)
    op = builder.graph()[value].op
    # an expression such as |2 x − 1| has no simple proximal step: it uses plain gradients
    array = op.name if isinstance(op, ReadParameter) else None
    axes = builder.type(value).axes
    match function:
        case "l2":
            return builder.power(value, 2), None
        case "l1":
            return builder.apply("abs", value), None if array is None else Penalty(array, None)
        case _:
            pass
    if array is None:
        why = "this is an expression"
        context.findings.report(knowledge.no_array_to_group(why, call.arguments[0].span))
        raise LoweringFailed
    over = _dim(context, call, axes)
    squares = builder.power(value, 2)
    within = [axis.name for axis in axes if axis.name != over]
    norms = builder.apply("sqrt", reduce_axes(builder, squares, within))
    return builder.sum(norms, over), Penalty(array, over)


def checked_penalties(
    losses: Sequence[Loss], parameters: Sequence[Parameter], findings: Findings
) -> list[Loss]:
    """The losses, with penalties only where a proximal step is possible.

    An l1 penalty of a bounded or fixed array becomes a plain loss. Reports E0967 for `group` of an
    array that has bounds or does not learn, E0968 for several groups of one array.
    """
    known = {parameter.name: parameter for parameter in parameters}
    grouped: set[str] = set()
    checked: list[Loss] = []
    for loss in losses:
        penalty = loss.penalty
        if penalty is not None:
            array = known[penalty.parameter]
            bounded = array.minimum is not None or array.maximum is not None
            # bounded parameters are trained by a raw variable (softplus, sigmoid), in which |x| is
            # differentiable
            if penalty.over is None:
                loss = replace(loss, penalty=None) if bounded or not array.learn else loss
            elif bounded or not array.learn:
                why = f"`{array.name}` {'has bounds' if bounded else 'does not learn'}"
                findings.report(knowledge.no_array_to_group(why, loss.span))
            elif array.name in grouped:
                findings.report(knowledge.several_groups(array.name, loss.span))
            else:
                grouped.add(array.name)
        checked.append(loss)
    return checked


def _dim(context: Context, call: Call, axes: tuple[Axis, ...]) -> str:
    named = {_WORDS.get(axis.name, axis.name.rpartition(".")[2]): axis for axis in axes}
    over = option(call, "over")
    if over is None:
        context.findings.report(knowledge.group_over_nothing(tuple(named), call.span))
        raise LoweringFailed
    name = over.name if isinstance(over, Name) else ""
    if name not in named:
        shown = describe_axes(tuple(Axis(word, axis.size) for word, axis in named.items()))
        context.findings.report(shapes.no_such_axis("group", name or "?", shown, over.span))
        raise LoweringFailed
    return named[name].name
