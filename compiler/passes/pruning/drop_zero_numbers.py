"""Removes learned parameters that are exactly 0, and all nodes that only they use."""

from __future__ import annotations

from collections.abc import Collection

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.simplify.drop_unused import drop_unused


def drop_zero_numbers(program: Program, names: Collection[str]) -> Program:
    """Removes the parameters `names`, which are entirely 0: products are 0, sums lose the term.

    The new program has the same outputs if all values that are multiplied by 0 are finite: 0 · ∞ is
    also removed.

    Before: window form. After: the same form.

        %2: scalar = %k * %x                       # k is 0
        %4: scalar = %3 + %2

        %3: scalar = …                             # replaces %4
    """
    if not names:
        return program
    program = with_step(program, *_dropped(program.step, names))
    return drop_unused(with_start(program, *_dropped(program.start, names)))


def _dropped(graph: Graph, names: Collection[str]) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    zero: set[NodeId] = set()
    for index, node in graph:
        of = [arg in zero for arg in node.args]
        with builder.at(node.span):
            if _is_zero(node, of, names):
                zero.add(index)
                number = builder.constant(0.0, unit=node.type.unit)
                copies[index] = builder.broadcast(number, node.type.axes)
                continue
            args = tuple(copies[arg] for arg in node.args)
            match node.op:
                case ops.Add() if any(of):
                    # one operand remains: adding 0 would only change −0 to +0
                    copies[index] = args[of.index(False)]
                case ops.Subtract() if any(of):
                    copies[index] = args[0] if of[1] else builder.negate(args[1])
                case _:
                    copies[index] = copy_node(builder, node, args)
    return builder.graph(), copies


def _is_zero(node: Node, of: list[bool], names: Collection[str]) -> bool:
    """True if a value is 0 because parameters are 0; `of` flags its zero operands."""
    match node.op:
        case ops.ReadParameter(name):
            return name in names
        # every term of a contraction has a factor from the array, which is entirely 0
        case ops.Multiply() | ops.Contract():
            return any(of)
        # 0/x is 0, even if x can be 0: values are assumed finite
        case ops.Divide():
            return of[0]
        case (
            ops.Add()
            | ops.Subtract()
            | ops.Negate()
            | ops.Identity()
            | ops.Sum()
            | ops.Broadcast()
            | ops.Reshape()
            | ops.Slice()
            | ops.Concat()
        ):
            return all(of)
        case _:
            # exp(0), for instance, is 1
            return False
