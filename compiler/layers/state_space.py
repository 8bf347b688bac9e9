"""`state_space`: a linear system with a state vector that is stable for all values of its
weights.
"""

from __future__ import annotations

from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from compiler.layers.affine import Affine
from compiler.layers.rules.layer_rule import Arguments, LayerContext, LayerRule
from compiler.layers.rules.memory import (
    CallMemory,
    Orders,
    declare_fit,
    initial_value,
    read_vector,
    starting,
)
from spec_schema.sections.layer_kinds import StateSpace


def state_space(context: LayerContext, settings: StateSpace, arguments: Arguments) -> NodeId:
    """x[t+1] = A x[t] + B u[t], y[t] = C x[t] (+ D u[t] with `feedthrough: true`).

    u is one value with one axis, a scalar, or several arguments concatenated. `order` is the length
    of x and `out` the axis of y. A = `radius` times the normalised lattice of reflection
    coefficients r (Gray and Markel 1975). All poles are inside that radius exactly if all |rᵢ| < 1,
    and ‖A x‖ ≤ radius ‖x‖. Array `reflection` is r, initially 0 (then A is a delay line); `B`, `C`,
    `D` are initially uniform in ±1/n for n summed elements. The state starts at 0 or at `init:`,
    one number or a list of `order`.

    `fit: "y[t+k]"`, where u is an expression of inputs and y a logged signal with the axes of the
    result, sets the arrays before the first stage. They become the system whose response to u is
    nearest to y[t+k] in the training rows: from one u to one y by Steiglitz and McBride 1965, else
    by a subspace method (Verhaegen 1994).
    """
    (value,) = arguments
    out = context.out(settings.out)
    if settings.fit is not None:
        declare_fit(context, settings.fit, value, _orders(settings, out))
    builder = context.builder
    order = context.own_axis("order", settings.order)
    memory = CallMemory.of(context, arguments, (order,), None)
    state = memory.value()
    (source,) = context.elements(value)
    result = Affine(weight="C", bias=None, out=out, init=None, bound=1.0 / order.size).of(
        context, state, order
    )
    if settings.feedthrough:
        direct = Affine(weight="D", bias=None, out=out, init=None, bound=1.0 / source.size).of(
            context, value, source
        )
        result = builder.add(result, direct)
    driven = Affine(weight="B", bias=None, out=(order,), init=None, bound=1.0 / source.size).of(
        context, value, source
    )
    following = builder.add(_turned(context, settings, state, order), driven)
    start = starting(context).builder
    initial = initial_value(context, settings.init, (Axis(UNNAMED, order.size),))
    if start.type(initial).axes:
        # a list in the spec has an axis without a name
        initial = start.rename(initial, UNNAMED, order.name)
    memory.becomes(following, initial, "state of the linear system")
    return result


def _turned(context: LayerContext, settings: StateSpace, state: NodeId, order: Axis) -> NodeId:
    """The node of A x for the node x = `state` along the axis `order`: one rotation of neighbouring
    elements for each reflection coefficient.
    """
    builder = context.builder
    axis = context.own_axis("section", order.size)
    doc = "reflection coefficients of the poles"
    reflection = context.learned("reflection", (axis,), 0.0, doc, low=-1.0, high=1.0)
    one = builder.constant(1.0)
    last = order.size - 1
    r = [builder.element(reflection, axis.name, i) for i in range(order.size)]
    x = [builder.element(state, order.name, i) for i in range(order.size)]
    forward = builder.negate(builder.multiply(r[last], x[last]))
    # each rotation passes `forward` on to the one before it, so they come from the last to the
    # first
    turned: list[NodeId] = []
    for i in reversed(range(last)):
        # r is the sine of the rotation: |r| < 1 whatever training does, so that √ has a slope
        cosine = builder.apply("sqrt", builder.subtract(one, builder.multiply(r[i], r[i])))
        turned.append(builder.add(builder.multiply(r[i], forward), builder.multiply(cosine, x[i])))
        forward = builder.subtract(builder.multiply(cosine, forward), builder.multiply(r[i], x[i]))
    turned.append(forward)
    axes = builder.type(forward).axes
    rows = [builder.reshape(row, (*axes, Axis(order.name, 1))) for row in reversed(turned)]
    joined = builder.concat(rows, order.name) if len(rows) > 1 else rows[0]
    return builder.multiply(builder.constant(settings.radius), joined)


def _orders(settings: StateSpace, out: tuple[Axis, ...]) -> Orders:
    order = settings.order
    return Orders(
        kind="state_space",
        num=order,
        den=order,
        feedthrough=settings.feedthrough,
        radius=settings.radius,
        out=out,
    )


STATE_SPACE = LayerRule(StateSpace, read_vector, state_space, is_black_box=True)
