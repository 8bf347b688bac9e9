"""`iir`: a recursive filter that is stable for all values of its weights."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import Axis
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from compiler.layers.rules.memory import (
    CallMemory,
    Orders,
    declare_fit,
    initial_value,
    read_signal,
    starting,
)
from spec_schema.sections.layer_kinds import Iir


def iir(context: LayerContext, settings: Iir, arguments: Arguments) -> NodeId:
    """The recursive filter y[t] = Σₖ b[k] w[t−k], k = 0 … num, of w[t] = x[t] − Σⱼ a[j] w[t−j], j =
    1 … den (direct form II).

    Its transfer function is Y/X = (b₀ + b₁z⁻¹ + …) / (1 + a₁z⁻¹ + …). The a follow from the
    reflection coefficients r: a⁽ⁱ⁾[j] = a⁽ⁱ⁻¹⁾[j] + rᵢ a⁽ⁱ⁻¹⁾[i−j], a⁽ⁱ⁾[i] = rᵢ (Levinson's
    recursion). The filter is stable exactly if all |rᵢ| < 1 (Schur and Cohn), and training keeps
    those bounds.

    Each element of a vector has its own filter. Array `num` is b from k = 0 on, initially uniform
    in ±1/(2 (num + 1)); array `reflection` is r, initially 0. The state `state`, w[t−1] first,
    starts at 0; with `init: e` as if x had always been e.

    `fit: "y[t+k]"`, where x is an expression of inputs and y a logged signal with the axes of x,
    sets the arrays before the first stage. They become the filter whose response to x is nearest to
    y[t+k] in the training rows (Steiglitz and McBride 1965).
    """
    (signal,) = arguments
    builder = context.builder
    unit = builder.type(signal).unit
    elements = context.elements(signal)
    if settings.fit is not None:
        orders = Orders(kind="iir", num=settings.num, den=settings.den, out=elements)
        declare_fit(context, settings.fit, signal, orders)
    # both sums read the same delays of w: the longer one says how many are kept
    depth = max(settings.num, settings.den)
    delays = context.own_axis("delay", depth)
    memory = CallMemory.of(context, arguments, (*elements, delays), unit)
    past = memory.value()
    # w[t] first, from its own past alone; y is then a sum of it and of the same past
    coefficients = _denominator(context, settings, elements)
    feedback = _sum_of_past(builder, coefficients, past, delays.name)
    now = builder.subtract(signal, feedback)
    axes = (*elements, context.own_axis("tap", settings.num + 1))
    start = context.initial("num", None, axes, 0.5 / (settings.num + 1))
    taps = context.learned("num", axes, start, "numerator, the newest sample first")
    result = builder.multiply(builder.element(taps, axes[-1].name, 0), now)
    if settings.num:
        # direct form II: one past w serves numerator and denominator
        older = [builder.element(taps, axes[-1].name, k) for k in range(1, settings.num + 1)]
        result = builder.add(result, _sum_of_past(builder, older, past, delays.name))
    # w[t] enters in front and the oldest delay leaves: the first one is w[t−1] in the next step
    rest = memory.type.axes[:-1]
    newest = builder.reshape(builder.broadcast(now, rest), (*rest, Axis(delays.name, 1)))
    kept = [newest]
    if depth > 1:
        kept.append(builder.slice(past, delays.name, 0, depth - 1))
    following = builder.concat(kept, delays.name) if depth > 1 else newest
    memory.becomes(following, _start(context, settings, elements), "past of the filter")
    return result


def _denominator(context: LayerContext, settings: Iir, elements: tuple[Axis, ...]) -> list[NodeId]:
    """The nodes of the coefficients a₁ … aₙ of the denominator, computed from the reflection
    coefficients; each has the axes `elements`.
    """
    builder = context.builder
    axes = (*elements, context.own_axis("section", settings.den))
    doc = "reflection coefficients of the denominator"
    reflection = context.learned("reflection", axes, 0.0, doc, low=-1.0, high=1.0)
    found: list[NodeId] = []
    for order in range(settings.den):
        r = builder.element(reflection, axes[-1].name, order)
        # the step-up recursion aₖ ← aₖ + r·aₙ₋ₖ (Levinson), one order after the other
        mirrored = reversed(found)
        found = [
            builder.add(a, builder.multiply(r, b)) for a, b in zip(found, mirrored, strict=True)
        ]
        found.append(r)
    return found


def _sum_of_past(
    builder: GraphBuilder, coefficients: list[NodeId], past: NodeId, axis: str
) -> NodeId:
    """c₁ w[t−1] + c₂ w[t−2] + …, with the nodes `coefficients` c₁, c₂, … and the node `past`, whose
    axis of this name holds w[t−1], w[t−2], ….
    """
    axes = builder.type(coefficients[0]).axes
    columns = [builder.reshape(c, (*axes, Axis(axis, 1))) for c in coefficients]
    row = builder.concat(columns, axis) if len(columns) > 1 else columns[0]
    return builder.contract_over(row, builder.slice(past, axis, 0, len(columns)), axis)


def _start(context: LayerContext, settings: Iir, elements: tuple[Axis, ...]) -> NodeId:
    """The node of the initial w of the filter, with the axes `elements`, as if the argument had
    always been e = `init`: w = e / (1 + Σ a). Without `init` it is 0. Raises LoweringFailed after
    reporting a mistake in `init`.
    """
    value = initial_value(context, settings.init, elements)
    if settings.init is None:
        return value
    start = starting(context)
    builder = start.builder
    # A(1) = Π (1 − pᵢ) is above 0 for poles inside the unit circle: the quotient always exists
    gain = builder.constant(1.0)
    for coefficient in _denominator(start, settings, elements):
        gain = builder.add(gain, coefficient)
    return builder.divide(value, gain)


IIR = LayerRule(Iir, read_signal, iir)
