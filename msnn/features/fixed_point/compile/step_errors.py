"""Bounds the error that one integer step, or the start, adds to each value (decision 0193)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from compiler.ir.program import Program
from msnn.features.fixed_point.compile.constants import finite
from msnn.features.fixed_point.integers.builder import IntegerBuilder
from msnn.features.fixed_point.integers.program import IntegerMemory, StepError, WordPort


def step_errors(
    program: Program,
    builder: IntegerBuilder,
    outputs: Sequence[tuple[WordPort, tuple[int, ...]]],
    memories: Sequence[IntegerMemory],
) -> Iterator[StepError]:
    """The error of the worst element of each output and state, from the errors of the nodes."""
    for port, nodes in outputs:
        worst = max(builder.errors[node] for node in nodes)
        yield StepError(port.name, is_state=False, largest=worst)
    for memory in memories:
        state = program.state(memory.name)
        error = max(builder.errors[node] for node in memory.next)
        if memory.restarts and _may_leave(builder, memory, error):
            error = math.inf  # one of the two may start anew
        limits = None if state.is_buffer else finite(state.range)
        if limits is not None:  # both are kept within their limits, which are rounded
            ends = zip(limits, (memory.low, memory.high), strict=True)
            error = max(error, *(abs(a - math.ldexp(b, -memory.fraction)) for a, b in ends))
        yield StepError(memory.name, is_state=True, largest=error)


def start_errors(builder: IntegerBuilder, memories: Sequence[IntegerMemory]) -> Iterator[StepError]:
    """The error of the worst element of each first state, limited to the range of its words."""
    for memory in memories:
        worst = max(builder.errors[node] for node in memory.start)
        yield StepError(memory.name, is_state=True, largest=worst)


def _may_leave(builder: IntegerBuilder, memory: IntegerMemory, error: float) -> bool:
    """True if the exact next value of a memory may be outside its range."""
    following = [builder[node] for node in memory.next]
    room = min(min(n.low - memory.low, memory.high - n.high) for n in following)
    return math.ldexp(room, -memory.fraction) <= error
