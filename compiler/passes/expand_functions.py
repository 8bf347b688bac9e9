"""Replaces scalar functions that a backend lacks by their definitions."""

from __future__ import annotations

from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.ops import Apply
from compiler.ir.program import Graph, NodeId, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS, ByFormula, ByKernel


def expand_functions(program: Program, native: frozenset[str]) -> Program:
    """Replaces each `Apply` of a function that is not in `native` by the function's definition in
    the table of scalar functions.

    Before: any form. After: every `Apply` is of a native function. Raises ValueError for a function
    without definition. Example, before and after:

        %1: scalar 1 = tan(%0)                    # native: sin, cos

        %1: scalar 1 = sin(%0)
        %2: scalar 1 = cos(%0)
        %3: scalar 1 = %1 / %2
    """
    program = with_step(program, *_expanded(program.step, native))
    return with_start(program, *_expanded(program.start, native))


def _expanded(graph: Graph, native: frozenset[str]) -> tuple[Graph, dict[NodeId, NodeId]]:
    # the current id of each node of the first graph
    places = {index: index for index, _ in graph}
    # a definition may use other functions that are not native
    while any(isinstance(node.op, Apply) and node.op.function not in native for _, node in graph):
        builder = GraphBuilder()
        copies: dict[NodeId, NodeId] = {}
        for index, node in graph:
            args = tuple(copies[arg] for arg in node.args)
            if isinstance(node.op, Apply) and node.op.function not in native:
                with builder.at(node.span):
                    copies[index] = _definition(builder, node.op.function, args)
                # the value keeps its label
                if node.label is not None:
                    builder.name(copies[index], node.label)
            else:
                copies[index] = copy_node(builder, node, args)
        graph = builder.graph()
        places = {index: copies[place] for index, place in places.items()}
    return graph, places


def _definition(builder: GraphBuilder, function: str, args: tuple[NodeId, ...]) -> NodeId:
    match SCALAR_FUNCTIONS[function].definition:
        case ByFormula(formula):
            return formula(builder, args)
        case ByKernel(name):
            # imported on demand: kernels are large and most programs need none
            from compiler.kernels.expand import expand_kernel

            return expand_kernel(builder, name, args)
        case None:
            message = f"`{function}` has no definition in other functions"
            raise ValueError(message)
