"""Inserts the weights as constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.ops import Constant, ReadParameter
from compiler.ir.program import Graph, NodeId, Program
from compiler.passes import run_passes


def with_numbers(program: Program, weights: Mapping[str, NDArray[Any]]) -> Program:
    """The program without losses, in which `weights` (physical values by name) replace the
    parameters as constants.
    """
    replaced: list[tuple[Graph, dict[NodeId, NodeId]]] = []
    for graph in (program.step, program.start):
        builder, copies = GraphBuilder(), dict[NodeId, NodeId]()
        for index, node in graph:
            if isinstance(node.op, ReadParameter):
                numbers = np.asarray(weights[node.op.name], np.float64).ravel()
                constant = Constant(tuple(float(number) for number in numbers))
                node = replace(node, op=constant)
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
        replaced.append((builder.graph(), copies))
    program = with_start(with_step(replace(program, losses=()), *replaced[0]), *replaced[1])
    return run_passes(program)
