"""Makes sums over fuzzy sets independent of terms that are 0, so that code may omit them."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.program import NodeId, Program
from compiler.passes.analyses.compact_sets import (
    active_sums,
    compact_sets,
    is_positive_zero,
    supports,
)


def settle_zeros(program: Program) -> Program:
    """Adds +0 to each sum over compact fuzzy sets, so that a sum of zeros is +0.

    Otherwise the sign of such a 0 would depend on the signs of all terms, including inactive sets,
    and generated code could not omit these. No other value changes.

    Before and after: any form. Example, before and after:

        %8: scalar = contract(%6, %7) over phi

        %8: scalar = contract(%6, %7) over phi
        %9: scalar = %8 + 0.0
    """
    sums = active_sums(program.step, supports(program.step, compact_sets(program.step)))
    # idempotent: skips sums that have the +0 already
    settled = {
        arg
        for _, node in program.step
        for arg in node.args[:1]
        if len(node.args) == 2 and is_positive_zero(program.step, node.args[1])
    }
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        copy = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
        if index in sums and index not in settled:
            with builder.at(node.span):
                zero = builder.broadcast(builder.constant(0.0), node.type.axes)
                copy = builder.add(copy, zero)
        copies[index] = copy
    return with_step(program, builder.graph(), copies)
