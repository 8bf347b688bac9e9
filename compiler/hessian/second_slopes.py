"""Gives the second slopes of a scalar function: reverse mode on the formulas of its slopes."""

from __future__ import annotations

from compiler.differentiation.reverse_mode import gradients
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Node, NodeId

_HELD = "operand'"
"""Marks an operand while the formula is differentiated; no name of a spec has a quote."""


def second_slopes(builder: GraphBuilder, node: NodeId) -> dict[tuple[NodeId, NodeId], NodeId]:
    """∂²φ/∂a∂b of an `Apply` by its operands a, b, each pair once, in the axes of the node.

    Operands are nodes: where both are the same one, as in atan2(x, x), it is that of φ(x, x).
    """
    b = builder
    made = b.node(node)
    assert isinstance(made.op, ops.Apply)
    operands = list(dict.fromkeys(made.args))
    # an operand may be made of another one: what is held is made of nothing
    held = {operand: b.named(operand, f"{_HELD}{i}") for i, operand in enumerate(operands)}
    args = tuple(held[arg] for arg in made.args)
    value = b.emit(made.op, args, made.type)
    one = b.broadcast(b.constant(1.0), made.type.axes)
    firsts = gradients(b, {value: one}, list(held.values()))
    found: dict[tuple[NodeId, NodeId], NodeId] = {}
    for i, (operand, first) in enumerate(zip(operands, firsts, strict=True)):
        if first is None:
            continue
        others = operands[i:]
        seconds = gradients(b, {first: one}, [held[other] for other in others])
        for other, second in zip(others, seconds, strict=True):
            if second is None:
                continue
            if b.infinite_values.is_made_of_infinite(second):
                b.infinite_values.expect(second)
            found[operand, other] = second
    return found


def is_held(node: Node) -> bool:
    """Whether a node only marks its operand."""
    return isinstance(node.op, ops.Named) and node.op.name.startswith(_HELD)
