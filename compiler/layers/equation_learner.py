"""`equation_learner`: a weighted sum of chosen functions of learned combinations of the inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.scalars import SIGNATURES
from compiler.ir.types import UNNAMED, Axis, describe_axes
from compiler.layers.affine import Affine
from compiler.layers.rules.arguments import read_elements
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from spec_schema.errors import names, shapes
from spec_schema.fields.leaf import Located
from spec_schema.sections.layer_kinds import EquationLearner
from spec_schema.sections.values import Function


def equation_learner(
    context: LayerContext, settings: EquationLearner, arguments: Arguments
) -> NodeId:
    """y = V [f₁(z₁), f₂(z₂, z₃), …] + c with z = W x + b, where z has as many elements as the
    functions f have arguments.

    x is as in `linear`. `functions` are functions of the language (`sin`, `tanh`, `max`, …) or of
    the spec, and `identity`, `neg`, `square`, `add`, `sub`, `mul`; each takes the next elements of
    z. `out` is the axis of y; with `mix: false` the value is [f₁, f₂, …] itself. The arrays W, b,
    V, c are called `weight_in`, `bias_in`, `weight_out`, `bias_out`. Weights are initially uniform
    in ±1/n for n summed elements, biases (none with `bias: false`) 0. (Martius and Lampert 2016.)
    """
    (value,) = arguments
    builder = context.builder
    arities = [_arity(context, function) for function in settings.functions]
    inner = context.own_axis("in", sum(arities))
    summed = context.elements(value)[-1]
    bias = ("bias_in", "bias_out") if settings.bias else (None, None)
    first = Affine(
        weight="weight_in", bias=bias[0], out=(inner,), init=settings.init, bound=1.0 / summed.size
    )
    z = first.of(context, value, summed)
    values: list[NodeId] = []
    taken = 0
    for function, arity in zip(settings.functions, arities, strict=True):
        operands = [builder.element(z, inner.name, taken + i) for i in range(arity)]
        taken += arity
        values.append(_term(context, function, operands))
    terms = context.own_axis("term", len(values))
    one = Axis(terms.name, 1)
    parts = [builder.reshape(v, (one, *builder.type(v).axes)) for v in values]
    joined = builder.concat(parts, terms.name) if len(parts) > 1 else parts[0]
    if not settings.mix:
        return builder.rename(joined, terms.name, UNNAMED)
    out = context.out(settings.out)
    last = Affine(
        weight="weight_out", bias=bias[1], out=out, init=settings.init, bound=1.0 / len(values)
    )
    return last.of(context, joined, terms)


_Operator: TypeAlias = Callable[[GraphBuilder, Sequence[NodeId]], NodeId]

_OPERATORS: dict[str, tuple[int, _Operator]] = {
    "identity": (1, lambda builder, z: z[0]),
    "neg": (1, lambda builder, z: builder.negate(z[0])),
    "square": (1, lambda builder, z: builder.power(z[0], 2)),
    "add": (2, lambda builder, z: builder.add(*z)),
    "sub": (2, lambda builder, z: builder.subtract(*z)),
    "mul": (2, lambda builder, z: builder.multiply(*z)),
}
"""Functions that have no name in the language: their number of operands and their lowering."""


def _term(context: LayerContext, function: Located[str], operands: list[NodeId]) -> NodeId:
    own = _OPERATORS.get(function.value)
    # a function of the spec with that name comes first
    if own is not None and function.value not in context.lowering.scope:
        return own[1](context.builder, operands)
    return context.apply(function, operands)


def _arity(context: LayerContext, function: Located[str]) -> int:
    name, scope = function.value, context.lowering.scope
    entry = scope[name].entry if name in scope else None
    if isinstance(entry, Function):
        return len(entry.args)
    if entry is not None:
        context.refuse(names.not_callable(name, scope[name].kind.value, function.span))
    if name in _OPERATORS:
        return _OPERATORS[name][0]
    if name not in SIGNATURES:
        known = (*_OPERATORS, *SIGNATURES)
        context.refuse(names.unknown_name(name, function.span, known, "a function"))
    # the fewest arguments that a function of the language can be called with
    return SIGNATURES[name].least


def _read(context: LayerContext, settings: EquationLearner) -> Arguments:
    arguments = read_elements(context, settings)
    elements = context.elements(arguments[0])
    if len(elements) != 1:
        what, place = f"the argument of `{context.name}`", context.call.arguments[0].span
        context.refuse(shapes.wrong_axes(what, "a vector", describe_axes(elements), place))
    return arguments


EQUATION_LEARNER = LayerRule(EquationLearner, _read, equation_learner, is_black_box=True)
