"""The functions that every spec has: scalar functions, reductions, lists, selection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from compiler.builtins.derivatives import lower_derivative
from compiler.builtins.gradients import lower_gradient
from compiler.builtins.integrals import lower_integral
from compiler.builtins.matrices import lower_eye, lower_outer, lower_smooth_sign, lower_softmax
from compiler.builtins.number_lists import number_list
from compiler.builtins.reductions import lower_mean, lower_sum
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.scalar_functions import SCALAR_FUNCTIONS
from compiler.ir.types import UNNAMED, WINDOW, Axis, describe_axes
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import aligning, lower, lower_all
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import names, shapes
from spec_schema.expressions.tree import Call, Expression, Name

if TYPE_CHECKING:
    from compiler.elaboration.names import Model


@dataclass(frozen=True)
class Builtin:
    """A builtin function: how many arguments, which keywords, and what it makes of them."""

    least: int
    most: int | None
    lower: Callable[[Model, Call, Environment], NodeId]
    keywords: tuple[str, ...] = ()
    doc: str = ""

    @property
    def wanted(self) -> str:
        """The number of arguments in words."""
        if self.most is None:
            return f"{self.least} or more arguments"
        if self.least == self.most:
            return f"{self.least} argument{'s' if self.least > 1 else ''}"
        return f"{self.least} to {self.most} arguments"


def lower_builtin(
    model: Model, name: str, builtin: Builtin, call: Call, environment: Environment
) -> NodeId:
    """The node of a call of a builtin, after its arguments are counted and its keywords known."""
    for keyword in call.keywords:
        if keyword.name not in builtin.keywords:
            model.findings.report(
                names.unknown_keyword(name, keyword.name, keyword.span, builtin.keywords)
            )
            raise LoweringFailed
    found = len(call.arguments)
    if found < builtin.least or (builtin.most is not None and found > builtin.most):
        model.findings.report(
            names.wrong_argument_count(name, builtin.wanted, found, call.function.span)
        )
        raise LoweringFailed
    return builtin.lower(model, call, environment)


def _keyword(call: Call, name: str) -> Expression | None:
    return next((k.value for k in call.keywords if k.name == name), None)


def _scalar(name: str) -> Callable[[Model, Call, Environment], NodeId]:
    def lower_scalar(model: Model, call: Call, environment: Environment) -> NodeId:
        builder = model.builder(environment)
        nodes = lower_all(model, call.arguments, environment)
        with aligning(model, name, call, call.arguments[0], call.arguments[-1]):
            return builder.apply(name, *nodes)

    return lower_scalar


def _unary(make: Callable[[GraphBuilder, NodeId], NodeId]) -> Callable[..., NodeId]:
    def lower_unary(model: Model, call: Call, environment: Environment) -> NodeId:
        return make(model.builder(environment), lower(model, call.arguments[0], environment))

    return lower_unary


def _relu(builder: GraphBuilder, x: NodeId) -> NodeId:
    # The constant stands first: a tie takes its slope, so relu'(0) = 0.
    return builder.maximum(builder.constant(0.0), x)


def _elu(builder: GraphBuilder, x: NodeId) -> NodeId:
    zero = builder.constant(0.0)
    # The argument of exp is never positive, so that the branch not taken cannot overflow.
    grown = builder.apply("exp", builder.minimum(x, zero))
    negative = builder.subtract(grown, builder.constant(1.0))
    return builder.select(builder.compare(Relation.GREATER, x, zero), x, negative)


def _sech(builder: GraphBuilder, x: NodeId) -> NodeId:
    return builder.divide(builder.constant(1.0), builder.apply("cosh", x))


def _extreme(name: str) -> Callable[[Model, Call, Environment], NodeId]:
    def lower_extreme(model: Model, call: Call, environment: Environment) -> NodeId:
        builder = model.builder(environment)
        nodes = lower_all(model, call.arguments, environment)
        result = nodes[0]
        for argument, node in zip(call.arguments[1:], nodes[1:], strict=True):
            with aligning(model, name, call, call.arguments[0], argument):
                combine = builder.minimum if name == "min" else builder.maximum
                result = combine(result, node)
        return result

    return lower_extreme


def _clip(model: Model, call: Call, environment: Environment) -> NodeId:
    nodes = lower_all(model, call.arguments, environment)
    with aligning(model, "clip", call, call.arguments[0], call.arguments[1]):
        return model.builder(environment).clamp(*nodes)


def _where(model: Model, call: Call, environment: Environment) -> NodeId:
    builder = model.builder(environment)
    condition, then, otherwise = lower_all(model, call.arguments, environment)
    if builder.type(condition).kind != "bool":
        model.findings.report(
            shapes.wrong_axes(
                "the first argument of `where`", "a comparison", "a number", call.arguments[0].span
            )
        )
        raise LoweringFailed
    with aligning(model, "where", call, call.arguments[1], call.arguments[2]):
        return builder.select(condition, then, otherwise)


def _concat(model: Model, call: Call, environment: Environment) -> NodeId:
    builder = model.builder(environment)
    parts: list[NodeId] = []
    for argument, node in zip(
        call.arguments, lower_all(model, call.arguments, environment), strict=True
    ):
        type = builder.type(node)
        others = [axis for axis in type.axes if axis.name not in (UNNAMED, WINDOW)]
        if others:
            model.findings.report(
                shapes.wrong_axes(
                    "an argument of `concat`",
                    "a scalar, a list or a window",
                    describe_axes(type.axes),
                    argument.span,
                )
            )
            raise LoweringFailed
        parts.append(builder.reshape(node, (Axis(UNNAMED, type.size),)))
    return builder.concat(parts, UNNAMED) if len(parts) > 1 else parts[0]


def _stack(model: Model, call: Call, environment: Environment) -> NodeId:
    builder = model.builder(environment)
    nodes = lower_all(model, call.arguments, environment)
    name, size = UNNAMED, len(nodes)
    dim = _keyword(call, "dim")
    if dim is not None:
        name = dim.name if isinstance(dim, Name) else "?"
        known = model.dimension(name, dim.span)
        if known.size != size:
            found = f"{size} values"
            model.findings.report(
                shapes.wrong_axes(
                    f"`stack` along `{name}`", f"{known.size} values", found, call.span
                )
            )
            raise LoweringFailed
    axes: tuple[Axis, ...] = ()
    for argument, node in zip(call.arguments, nodes, strict=True):
        with aligning(model, "stack", call, call.arguments[0], argument):
            _, _, axes = builder.aligned(
                builder.broadcast(nodes[0], axes or builder.type(nodes[0]).axes), node
            )
    if any(axis.name == name for axis in axes):
        new = f"without the new axis `{name}`" if name != UNNAMED else "without an unnamed axis"
        found, place = describe_axes(axes), call.arguments[0].span
        model.findings.report(shapes.wrong_axes("what `stack` is given", new, found, place))
        raise LoweringFailed
    parts = [
        builder.reshape(builder.broadcast(node, axes), (Axis(name, 1), *axes)) for node in nodes
    ]
    return builder.concat(parts, name) if len(parts) > 1 else parts[0]


def _part(model: Model, call: Call, environment: Environment) -> NodeId:
    """`part(q, joint2)`: one labelled element; `part(x, 0)`: one of an unnamed axis."""
    builder = model.builder(environment)
    node = lower(model, call.arguments[0], environment)
    wanted = call.arguments[1]
    axes = builder.type(node).axes
    if isinstance(wanted, Name):
        for axis in axes:
            labels = model.labels(axis.name)
            if wanted.name in labels:
                return builder.element(node, axis.name, labels.index(wanted.name))
        labels = [f"`{label}`" for axis in axes for label in model.labels(axis.name)]
        among = f"its elements are {', '.join(labels)}" if labels else "`dims:` gives it no labels"
        report = shapes.no_such_element(wanted.name, describe_axes(axes), among, wanted.span)
        model.findings.report(report)
        raise LoweringFailed
    index = model.whole_number(wanted, environment, "the index of `part`")
    spatial = [axis for axis in axes if axis.name != WINDOW]
    if len(spatial) != 1 or not 0 <= index < spatial[0].size:
        among = "a number takes an element of a value of one axis"
        if len(spatial) == 1:
            among = f"its elements are 0 to {spatial[0].size - 1}"
        report = shapes.no_such_element(str(index), describe_axes(axes), among, wanted.span)
        model.findings.report(report)
        raise LoweringFailed
    return builder.element(node, spatial[0].name, index)


def _dropout(model: Model, call: Call, environment: Environment) -> NodeId:
    node = lower(model, call.arguments[0], environment)
    rate = model.number(call.arguments[1], environment, "the share of `dropout`")
    if not 0 <= rate < 1:
        problem = f"must be at least 0 and below 1, not {rate:g}"
        report = names.unfit_constant("the share of `dropout`", problem, call.arguments[1].span)
        model.findings.report(report)
        raise LoweringFailed
    return model.builder(environment).dropout(node, rate, "")


BUILTINS: dict[str, Builtin] = {
    row.name: Builtin(row.arity, row.arity, _scalar(row.name), doc=row.doc)
    for row in SCALAR_FUNCTIONS.values()
} | {
    "relu": Builtin(1, 1, _unary(_relu), doc="max(x, 0); slope 0 at 0."),
    "elu": Builtin(1, 1, _unary(_elu), doc="x above 0, exp(x) − 1 below."),
    "sech": Builtin(1, 1, _unary(_sech), doc="1 / cosh(x)."),
    "min": Builtin(2, None, _extreme("min"), doc="The smallest argument, element by element."),
    "max": Builtin(2, None, _extreme("max"), doc="The largest argument, element by element."),
    "clip": Builtin(3, 3, _clip, doc="clip(x, low, high)."),
    "where": Builtin(3, 3, _where, doc="where(condition, then, otherwise)."),
    "sum": Builtin(1, 1, lower_sum, ("over",), "Sum of everything, or over the axes of `over=`."),
    "mean": Builtin(
        1, 1, lower_mean, ("over",), "Mean of everything, or over the axes of `over=`."
    ),
    "concat": Builtin(1, None, _concat, doc="Scalars, lists and windows one after the other."),
    "stack": Builtin(1, None, _stack, ("dim",), "The arguments side by side along a new axis."),
    "part": Builtin(2, 2, _part, doc="One element of an axis, by label or index."),
    "softmax": Builtin(1, 1, lower_softmax, ("over",), "Shares that sum to 1 along an axis."),
    "outer": Builtin(2, 2, lower_outer, doc="outer(a, b): all products of an element of each."),
    "eye": Builtin(1, 2, lower_eye, doc="eye(a, b) of two dims; eye(3) in `constants:`."),
    "smooth_sign": Builtin(1, 2, lower_smooth_sign, doc="smooth_sign(x, width) = tanh(x / width)."),
    "dropout": Builtin(
        2, 2, _dropout, doc="dropout(x, share): x, of which training leaves out a share."
    ),
    "linspace": Builtin(3, 3, number_list("linspace"), doc="linspace(first, last, count)."),
    "arange": Builtin(1, 3, number_list("arange"), doc="arange(start, stop, step), stop excluded."),
    "integral": Builtin(
        1, 1, lower_integral, ("method", "init"), "Integral over time since the start of a run."
    ),
    "der": Builtin(1, 1, lower_derivative, ("method",), "Derivative with respect to time."),
    "grad": Builtin(2, 2, lower_gradient, doc="grad(y, x): Σ ∂y/∂x in one sample, shape of x."),
    "zeros": Builtin(1, 1, number_list("zeros"), doc="zeros(count)."),
    "ones": Builtin(1, 1, number_list("ones"), doc="ones(count)."),
}
"""By name; `next` and `flow` are in `states.py`, losses in `losses.py`."""
