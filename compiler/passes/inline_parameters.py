"""Replaces parameters by constants, for exports with fixed weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import physical_weights
from compiler.ir.builder import with_start, with_step
from compiler.ir.ops import Constant, ReadParameter
from compiler.ir.program import Graph, Node, NodeId, Program


def inline_parameters(program: Program, weights: Mapping[str, ArrayLike]) -> Program:
    """Replaces each parameter by a constant of its name, with the physical value from `weights`, or
    its initial value if they lack it.

    Before and after: any form. Nodes keep their types and labels; nothing is computed. Raises
    ValueError for a weight of wrong shape. Example, before and after:

        %0: scalar = parameter k

        %0: scalar = constant 0.3 (k)
    """
    known = physical_weights(program, weights)
    values = {name: tuple(float(x) for x in array.ravel()) for name, array in known.items()}
    program = with_step(program, *_inlined(program.step, values))
    program = with_start(program, *_inlined(program.start, values))
    return replace(program, parameters=())


def _inlined(
    graph: Graph, values: Mapping[str, tuple[float, ...]]
) -> tuple[Graph, dict[NodeId, NodeId]]:
    nodes = tuple(_known(node, values) for node in graph.nodes)
    # replaces nodes one by one, so that node ids stay valid
    return Graph(nodes), {index: index for index in range(len(nodes))}


def _known(node: Node, values: Mapping[str, tuple[float, ...]]) -> Node:
    if not isinstance(node.op, ReadParameter):
        return node
    return replace(node, op=Constant(values[node.op.name], node.op.name))
