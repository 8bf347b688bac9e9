"""Clamps equations to the ranges that the spec declares for them, since fixed-point formats rely on
these bounds.
"""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.program import NodeId, Program


def limit_expected(program: Program) -> Program:
    """Clamps the value of each equation that has a declared range; all nodes that used it use the
    clamped value.

    Before and after: any form. `expected` still names the unclamped values, so that values outside
    the range can be reported. Example, before and after:

        %3: scalar m = %1 * %2
        expected e = %3 in [0.0, 5.0]           # %7 uses %3

        %3: scalar m = %1 * %2
        %6: scalar m = clamp(%3, %4, %5)        # 0.0 and 5.0; %9 uses %6
        expected e = %3 in [0.0, 5.0]
    """
    ranges = {entry.node: entry.range for entry in program.expected}
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    raw: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        copy = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
        if index in ranges:
            raw[index] = copy
            with builder.at(node.span):
                low, high = (builder.constant(end, unit=node.type.unit) for end in ranges[index])
                copy = builder.clamp(copy, low, high)
        copies[index] = copy
    # outputs and states that are the equation itself are clamped as well
    limited = with_step(program, builder.graph(), copies)
    expected = tuple(replace(entry, node=raw[entry.node]) for entry in program.expected)
    return replace(limited, expected=expected)
