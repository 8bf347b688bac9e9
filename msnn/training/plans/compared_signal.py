"""Finds the target signal of a loss."""

from __future__ import annotations

from compiler.ir import ops
from compiler.ir.program import Loss, Program


def compared_signal(program: Program, loss: Loss) -> str | None:
    """The signal whose samples are the target of a loss; None if the target is another value."""
    node = None if loss.target is None else program.step[loss.target]
    # these show samples of the signal in another shape
    while node is not None and isinstance(node.op, ops.Broadcast | ops.Reshape | ops.Slice):
        node = program.step[node.args[0]]
    if node is None or not isinstance(node.op, ops.ReadSamples):
        return None
    return node.op.signal
