"""Finds terms that are infinite or NaN for any data: `sqrt(-1)`, `x / 0`."""

from __future__ import annotations

from compiler.ir import ops
from compiler.ir.program import Graph, NodeId, Program
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.errors import names as errors

_ARITHMETIC = (ops.Add, ops.Subtract, ops.Multiply, ops.Divide, ops.Apply)


def never_finite(program: Program) -> list[Diagnostic]:
    """Warns about terms that are never finite; the program has been through the passes."""
    graph = program.step
    found: dict[Diagnostic, None] = {}
    for _, node in graph:
        operands = [graph[arg].op for arg in node.args]
        # constant terms have been folded, unless the result is infinite or NaN
        constant = bool(operands) and all(isinstance(op, ops.Constant) for op in operands)
        by_zero = isinstance(node.op, ops.Divide) and _is_zero(graph, node.args[1])
        if node.span is not None and isinstance(node.op, _ARITHMETIC) and (constant or by_zero):
            found[errors.never_finite(node.span)] = None
    return list(found)


def _is_zero(graph: Graph, node: NodeId) -> bool:
    op = graph[graph.unrepeated(node)].op
    return isinstance(op, ops.Constant) and not all(op.values)
