"""Limits the next value of a state to its range (`on_range: saturate`), and finds the value before
that limit.
"""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Clamp, Constant, Relation, Select
from compiler.ir.program import Graph, NodeId, Program, State


def saturated(
    builder: GraphBuilder, following: NodeId, before: NodeId, limits: tuple[float, float]
) -> NodeId:
    """The node of clip(following, low, high) with `limits` low, high; where `following` is NaN,
    `before`, the current value of the state.

    The derivative is 1 on the limits, 0 beyond them.
    """
    unit = builder.type(before).unit
    low, high = (builder.constant(limit, unit=unit) for limit in limits)
    clipped = builder.clamp(following, low, high)
    is_number = builder.compare(Relation.GREATER_EQUAL, clipped, low)
    return builder.select(is_number, clipped, before)


def unsaturated(program: Program) -> dict[str, NodeId]:
    """For each state with `on_range: saturate`, the node of its next value before the limit.

    States whose next value is a constant, and so never NaN, are omitted.
    """
    found: dict[str, NodeId] = {}
    for state in program.states:
        raw = _unsaturated(program.step, state)
        if raw is not None:
            found[state.name] = raw
    return found


def _unsaturated(step: Graph, state: State) -> NodeId | None:
    chosen = step[state.next]
    if state.on_range != "saturate" or not isinstance(chosen.op, Select):
        return None
    clipped = step[chosen.args[1]]
    assert isinstance(clipped.op, Clamp), "the outermost choice is the one of `saturated`"
    (raw, *_) = clipped.args
    is_known = isinstance(step[step.unrepeated(raw)].op, Constant)
    return None if is_known else raw
