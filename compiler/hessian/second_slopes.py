"""Second derivatives of scalar functions, by reverse mode on the formulas of their derivatives.

`ScalarFunction.curvatures` has explicit formulas where that would be wrong.
"""

from __future__ import annotations

from compiler.differentiation.reverse_mode import gradients
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Node, NodeId
from compiler.ir.scalars.table import SCALAR_FUNCTIONS


def second_slopes(builder: GraphBuilder, node: NodeId) -> dict[tuple[NodeId, NodeId], NodeId]:
    """∂²φ/∂a∂b of an `Apply`, by its operands a, b (each pair once), in the axes of the node.

    If both operands are the same node, as in atan2(x, x), it is the second derivative of φ(x, x).
    The formula is differentiated with `Named` operands, which remain in the graph.
    """
    made = builder.node(node)
    assert isinstance(made.op, ops.Apply)
    explicit = SCALAR_FUNCTIONS[made.op.function].curvatures
    if explicit is None:
        found = _slopes_of_slopes(builder, made)
    else:
        found = _by_operands(builder, made, explicit(builder, made.args, node))
    for second in found.values():
        if builder.infinite_values.is_made_of_infinite(second):
            builder.infinite_values.expect(second)
    return found


def _by_operands(
    b: GraphBuilder, made: Node, known: tuple[NodeId, NodeId, NodeId]
) -> dict[tuple[NodeId, NodeId], NodeId]:
    left, right = made.args
    in_left, mixed, in_right = known
    if left == right:
        return {(left, left): b.add(b.add(in_left, b.add(mixed, mixed)), in_right)}
    return {(left, left): in_left, (left, right): mixed, (right, right): in_right}


def _slopes_of_slopes(b: GraphBuilder, made: Node) -> dict[tuple[NodeId, NodeId], NodeId]:
    operands = list(dict.fromkeys(made.args))
    # one operand may depend on the other: naming makes them independent variables
    # (names of a spec have no quote)
    held = {operand: b.named(operand, f"operand'{i}") for i, operand in enumerate(operands)}
    value = b.emit(made.op, tuple(held[arg] for arg in made.args), made.type)
    one = b.broadcast(b.constant(1.0), made.type.axes)
    firsts = gradients(b, {value: one}, list(held.values()))
    found: dict[tuple[NodeId, NodeId], NodeId] = {}
    for i, first in enumerate(firsts):
        # second derivatives are symmetric: each pair once, starting at the diagonal
        others = operands[i:]
        wanted = [held[other] for other in others]
        seconds = [None] * len(wanted) if first is None else gradients(b, {first: one}, wanted)
        for other, second in zip(others, seconds, strict=True):
            if second is not None:
                found[operands[i], other] = second
    return found
