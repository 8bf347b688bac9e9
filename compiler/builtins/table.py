"""The table of the builtins with the function that lowers each: scalar functions, reductions,
lists, selection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from compiler.builtins.axes import (
    lower_eye,
    lower_mean,
    lower_outer,
    lower_smooth_sign,
    lower_softmax,
    lower_sum,
)
from compiler.builtins.call_options import option
from compiler.builtins.gradients import lower_gradient
from compiler.builtins.time import lower_derivative, lower_integral
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Apply, Relation
from compiler.ir.program import NodeId
from compiler.ir.rules import AxisConflict, distance_unit
from compiler.ir.scalars import SCALAR_FUNCTIONS, SIGNATURES
from compiler.ir.types import UNNAMED, WINDOW, Axis, describe_axes
from compiler.lowering.constants import number, refuse_infinite, whole_number
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import (
    aligning,
    lower,
    lower_all,
    lower_operands,
    warn_of_twin_axes,
)
from spec_schema.errors import names, shapes
from spec_schema.expressions.language import Signature
from spec_schema.expressions.tree import Call, Name, expression_text
from spec_schema.plugins import PluginPart
from spec_schema.registry import FunctionLine

LONGEST_LIST = 100_000


def number_list(name: str) -> Callable[[Context, Call, Environment], NodeId]:
    """The function that lowers calls of `name` (`linspace`, `arange`, `zeros` or `ones`) to a
    constant along an unnamed axis. It reports unusable arguments and raises LoweringFailed.
    """

    def lower_numbers(context: Context, call: Call, environment: Environment) -> NodeId:
        given = [number(context, each, f"an argument of `{name}`") for each in call.arguments]
        if name == "arange":
            count = _arange_count(given)
        else:
            count = whole_number(context, call.arguments[-1], f"the length of `{name}`")
        if not 1 <= count <= LONGEST_LIST:
            context.findings.report(
                names.unfit_constant(f"`{name}`", f"would have {count} elements", call.span)
            )
            raise LoweringFailed
        # a range from -1e308 to 1e308 overflows
        with np.errstate(all="ignore"):
            match name:
                case "linspace":
                    values = np.linspace(given[0], given[1], count)
                case "arange":
                    step = given[2] if len(given) > 2 else 1.0
                    start = given[0] if len(given) > 1 else 0.0
                    values = start + step * np.arange(count)
                case _:
                    values = np.full(count, 1.0 if name == "ones" else 0.0)
        refuse_infinite(context, f"`{name}`", values, call.span)
        return context.builder(environment).constant(values, (Axis(UNNAMED, count),))

    return lower_numbers


def _arange_count(given: list[float]) -> int:
    start, stop = (0.0, given[0]) if len(given) == 1 else (given[0], given[1])
    step = given[2] if len(given) > 2 else 1.0
    if step == 0 or not np.isfinite((stop - start) / step):
        return 0
    return max(0, int(np.ceil((stop - start) / step)))


_LONGEST_SHOWN = 60
"""Maximum number of characters of a user's formula that a help line repeats."""

Lower = Callable[[Context, Call, Environment], NodeId]


def lower_builtin(context: Context, name: str, call: Call, environment: Environment) -> NodeId:
    """The node of a call of the builtin `name`. Reports a wrong number of arguments, unknown
    keywords and other mistakes, and raises LoweringFailed.
    """
    _check_arguments(context, name, SIGNATURES[name], call)
    return LOWERINGS[name](context, call, environment)


def lower_plugin_function(
    context: Context, line: FunctionLine, call: Call, environment: Environment
) -> NodeId:
    """The node of a call of a function that a plug-in builds from core operations; `line` is its
    entry in the registry. Raises LoweringFailed after a mistake of the user, SpecError (E0230)
    after one of the plug-in.
    """
    _check_arguments(context, line.key, line.signature, call)
    context.plugin_functions.add(line.key)
    builder = context.builder(environment)
    # specs without plug-ins do not need it
    from compiler.layers.rules.plugin_nodes import (
        PluginBuilder,
        PluginNode,
        guarded_expansion,
    )

    part = PluginPart("function", line.key, line.expand.module, (LoweringFailed, AxisConflict))
    own, expand = PluginBuilder(builder), line.expand.value

    if not call.arguments:
        return guarded_expansion(part, expand, builder, call.span, own)
    nodes = lower_operands(context, call.arguments, environment)
    _warn_of_twin_axes(context, line.key, call, nodes, environment)
    with aligning(context, line.key, call, call.arguments[0], call.arguments[-1]):
        operands = [PluginNode(node, builder) for node in nodes]
        return guarded_expansion(part, expand, builder, call.span, own, *operands)


def _check_arguments(context: Context, name: str, signature: Signature, call: Call) -> None:
    for keyword in call.keywords:
        if keyword.name not in signature.keywords:
            context.findings.report(
                names.unknown_keyword(name, keyword.name, keyword.span, signature.keywords)
            )
            raise LoweringFailed
    found = len(call.arguments)
    if not signature.takes(found):
        context.findings.report(
            names.wrong_argument_count(name, signature.wanted, found, call.function.span)
        )
        raise LoweringFailed


def _scalar(name: str) -> Lower:
    def lower_scalar(context: Context, call: Call, environment: Environment) -> NodeId:
        builder = context.builder(environment)
        nodes = lower_operands(context, call.arguments, environment)
        _warn_of_twin_axes(context, name, call, nodes, environment)
        with aligning(context, name, call, call.arguments[0], call.arguments[-1]):
            return builder.apply(name, *nodes)

    return lower_scalar


def _unary(make: Callable[[GraphBuilder, NodeId], NodeId]) -> Callable[..., NodeId]:
    def lower_unary(context: Context, call: Call, environment: Environment) -> NodeId:
        return make(context.builder(environment), lower(context, call.arguments[0], environment))

    return lower_unary


def _warn_of_twin_axes(
    context: Context, name: str, call: Call, nodes: Sequence[NodeId], environment: Environment
) -> None:
    operands = zip(call.arguments, nodes, strict=True)
    warn_of_twin_axes(context, context.builder(environment), name, call, operands)


def _relu(builder: GraphBuilder, x: NodeId) -> NodeId:
    # the constant is the first operand: a tie uses its derivative, so relu'(0) = 0
    return builder.maximum(builder.constant(0.0), x)


def _elu(builder: GraphBuilder, x: NodeId) -> NodeId:
    zero = builder.constant(0.0)
    # the argument of exp is never positive, so that the other branch cannot overflow
    fallen = builder.minimum(x, zero)
    # an argument with a unit is used as a number in that unit: exp(x / unit) · unit
    unit = builder.type(x).unit
    grown = builder.emit(Apply("exp"), (fallen,), builder.type(fallen).with_unit(unit))
    negative = builder.subtract(grown, builder.constant(1.0, unit=distance_unit(unit)))
    return builder.select(builder.compare(Relation.GREATER, x, zero), x, negative)


def _sech(builder: GraphBuilder, x: NodeId) -> NodeId:
    return builder.divide(builder.constant(1.0), builder.apply("cosh", x))


def _extreme(name: str) -> Lower:
    def lower_extreme(context: Context, call: Call, environment: Environment) -> NodeId:
        builder = context.builder(environment)
        nodes = lower_operands(context, call.arguments, environment)
        _warn_of_twin_axes(context, name, call, nodes, environment)
        result = nodes[0]
        for argument, node in zip(call.arguments[1:], nodes[1:], strict=True):
            with aligning(context, name, call, call.arguments[0], argument):
                combine = builder.minimum if name == "min" else builder.maximum
                result = combine(result, node)
        return result

    return lower_extreme


def _clip(context: Context, call: Call, environment: Environment) -> NodeId:
    nodes = lower_operands(context, call.arguments, environment)
    _warn_of_twin_axes(context, "clip", call, nodes, environment)
    with aligning(context, "clip", call, call.arguments[0], call.arguments[1]):
        return context.builder(environment).clamp(*nodes)


def _where(context: Context, call: Call, environment: Environment) -> NodeId:
    builder = context.builder(environment)
    condition, then, otherwise = lower_operands(context, call.arguments, environment)
    if builder.type(condition).kind != "bool":
        context.findings.report(
            shapes.wrong_axes(
                "the first argument of `where`", "a comparison", "a number", call.arguments[0].span
            )
        )
        raise LoweringFailed
    operands = (condition, then, otherwise)
    _warn_of_twin_axes(context, "where", call, operands, environment)
    with aligning(context, "where", call, call.arguments[1], call.arguments[2]):
        return builder.select(condition, then, otherwise)


def _concat(context: Context, call: Call, environment: Environment) -> NodeId:
    builder = context.builder(environment)
    parts: list[NodeId] = []
    for argument, node in zip(
        call.arguments, lower_all(context, call.arguments, environment), strict=True
    ):
        type = builder.type(node)
        others = [axis for axis in type.axes if axis.name not in (UNNAMED, WINDOW)]
        if others:
            context.findings.report(
                shapes.wrong_axes(
                    "an argument of `concat`",
                    "a scalar, a list or a window",
                    describe_axes(type.axes),
                    argument.span,
                    _side_by_side(call),
                )
            )
            raise LoweringFailed
        parts.append(builder.reshape(node, (Axis(UNNAMED, type.size),)))
    return builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]


def _side_by_side(call: Call) -> str:
    texts = [expression_text(argument) for argument in call.arguments]
    given = ", ".join(texts)
    repair = "where a layer is given them it takes values side by side: leave `concat` out"
    return f"{repair}, `{given}`" if len(given) <= _LONGEST_SHOWN else repair


def _stack(context: Context, call: Call, environment: Environment) -> NodeId:
    builder = context.builder(environment)
    nodes = lower_all(context, call.arguments, environment)
    name, size = UNNAMED, len(nodes)
    dim = option(call, "dim")
    if dim is not None:
        name = dim.name if isinstance(dim, Name) else "?"
        known = context.dimension(name, dim.span)
        if known.size != size:
            found = f"{size} values"
            context.findings.report(
                shapes.wrong_axes(
                    f"`stack` along `{name}`", f"{known.size} values", found, call.span
                )
            )
            raise LoweringFailed
    axes: tuple[Axis, ...] = ()
    for argument, node in zip(call.arguments, nodes, strict=True):
        if any(axis.name == name for axis in builder.type(node).axes):
            new = f"without the new axis `{name}`" if name != UNNAMED else "without an unnamed axis"
            found, place = describe_axes(builder.type(node).axes), argument.span
            context.findings.report(shapes.wrong_axes("what `stack` is given", new, found, place))
            raise LoweringFailed
        with aligning(context, "stack", call, call.arguments[0], argument):
            _, _, axes = builder.aligned(
                builder.broadcast(nodes[0], axes or builder.type(nodes[0]).axes), node
            )
    parts = [
        builder.reshape(builder.broadcast(node, axes), (Axis(name, 1), *axes)) for node in nodes
    ]
    return builder.concat(parts, name, "stack") if len(parts) > 1 else parts[0]


def _part(context: Context, call: Call, environment: Environment) -> NodeId:
    """`part(q, joint2)` is the element of q with this label; `part(x, 0)` is one element of a value
    with one axis. Reports an element that does not exist and raises LoweringFailed.
    """
    builder = context.builder(environment)
    node = lower(context, call.arguments[0], environment)
    wanted = call.arguments[1]
    axes = builder.type(node).axes
    if isinstance(wanted, Name):
        for axis in axes:
            labels = context.labels(axis.name)
            if wanted.name in labels:
                return builder.element(node, axis.name, labels.index(wanted.name))
        labels = [f"`{label}`" for axis in axes for label in context.labels(axis.name)]
        among = f"its elements are {', '.join(labels)}" if labels else "`dims:` gives it no labels"
        report = shapes.no_such_element(wanted.name, describe_axes(axes), among, wanted.span)
        context.findings.report(report)
        raise LoweringFailed
    index = whole_number(context, wanted, "the index of `part`")
    spatial = [axis for axis in axes if axis.name != WINDOW]
    if len(spatial) != 1 or not 0 <= index < spatial[0].size:
        among = "a number takes an element of a value of one axis"
        if len(spatial) == 1:
            among = f"its elements are 0 to {spatial[0].size - 1}"
        report = shapes.no_such_element(str(index), describe_axes(axes), among, wanted.span)
        context.findings.report(report)
        raise LoweringFailed
    return builder.element(node, spatial[0].name, index)


def _dropout(context: Context, call: Call, environment: Environment) -> NodeId:
    node = lower(context, call.arguments[0], environment)
    rate = number(context, call.arguments[1], "the share of `dropout`")
    if not 0 <= rate < 1:
        problem = f"must be at least 0 and below 1, not {rate:g}"
        report = names.unfit_constant("the share of `dropout`", problem, call.arguments[1].span)
        context.findings.report(report)
        raise LoweringFailed
    return context.builder(environment).dropout(node, rate, "")


LOWERINGS: dict[str, Lower] = {name: _scalar(name) for name in SCALAR_FUNCTIONS} | {
    "relu": _unary(_relu),
    "elu": _unary(_elu),
    "sech": _unary(_sech),
    "min": _extreme("min"),
    "max": _extreme("max"),
    "clip": _clip,
    "where": _where,
    "sum": lower_sum,
    "mean": lower_mean,
    "concat": _concat,
    "stack": _stack,
    "part": _part,
    "softmax": lower_softmax,
    "outer": lower_outer,
    "eye": lower_eye,
    "smooth_sign": lower_smooth_sign,
    "dropout": _dropout,
    "linspace": number_list("linspace"),
    "arange": number_list("arange"),
    "integral": lower_integral,
    "der": lower_derivative,
    "grad": lower_gradient,
    "zeros": number_list("zeros"),
    "ones": number_list("ones"),
}
"""The lowering of each name of `SIGNATURES`; a test checks that both are complete."""
