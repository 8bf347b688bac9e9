"""Inserts the weights as constants, and chooses number formats from ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.ops import Constant, ReadParameter
from compiler.ir.program import Graph, NodeId, Program
from compiler.passes import run_passes

_SMALLEST = 2.0**-96
"""Smallest range: float32, in which C converts words, has no finer scales."""


def with_numbers(program: Program, weights: Mapping[str, NDArray[Any]]) -> Program:
    """The program with its parameters as folded constants."""
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


def finite(limits: tuple[float, float] | None) -> tuple[float, float] | None:
    """The limits if both are finite, else None."""
    return limits if limits is not None and all(map(math.isfinite, limits)) else None


def word_format(low: float, high: float, bits: int) -> tuple[int, int, int]:
    """Binary fraction digits, and integer limits, of values low … high with this number of bits."""
    # what is always 0 has a format too
    reach = max(abs(low), abs(high), _SMALLEST) if low or high else 2.0**-bits
    # reach = m · 2^e with m in [1/2, 1): a bit for the sign, e before the point, the rest behind it
    fraction = bits - 1 - math.frexp(reach)[1]
    # just below a power of 2 rounding reaches it, one unit more than the bits can hold
    if round(math.ldexp(reach, fraction)) == 2 ** (bits - 1):
        fraction -= 1
    return fraction, round(math.ldexp(low, fraction)), round(math.ldexp(high, fraction))
